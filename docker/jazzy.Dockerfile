# The graph on stock ROS 2 Jazzy (Ubuntu 24.04, apt packages) in place of the wheels of requirements.txt.
#     docker build -f docker/jazzy.Dockerfile -t waam . && docker run --rm -it --network host waam
# Not built here, where there is no Docker: docs/ros.md says what was tried of it.
FROM ros:jazzy-ros-base
RUN apt-get update && apt-get install -y --no-install-recommends \
        python3-pip ros-jazzy-control-msgs ros-jazzy-tf2-msgs ros-jazzy-rmw-fastrtps-cpp \
        ros-jazzy-ros2bag ros-jazzy-rosbag2-storage-mcap \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /waam
COPY requirements.txt requirements-open3d.txt ./
# The messages of the apt packages are compiled for NumPy 1.26. pyarrow after 22 and the metadata of rerun-sdk ask for
# NumPy 2, so both are installed without their dependencies.
RUN sed -n '/^# Libraries of the nodes/,$p' requirements.txt | grep -Ev '^(numpy|pyarrow|rerun-sdk)' > libraries.txt \
    && pip install --no-cache-dir --break-system-packages --ignore-installed \
        'numpy<2' attrs pillow typing_extensions -r libraries.txt \
    && pip install --no-cache-dir --break-system-packages --no-deps \
        pyarrow==22.0.0 'rerun-sdk==0.41.*' -r requirements-open3d.txt
COPY . .
RUN . /opt/ros/jazzy/setup.sh && cd waam_ws && colcon build --base-paths src
ENTRYPOINT ["/bin/bash", "-c", ". /opt/ros/jazzy/setup.bash && . /waam/waam_ws/install/setup.bash && exec \"$@\"", "waam"]
# the simulated cell; `ros2 run waam_bringup waam --help` has the commands
CMD ["ros2", "launch", "waam_bringup", "cell.launch.py"]
