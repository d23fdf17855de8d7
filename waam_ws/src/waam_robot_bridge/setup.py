from setuptools import find_packages, setup

setup(
    name='waam_robot_bridge',
    version='0.3.0',
    packages=find_packages(exclude=['test']),
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/waam_robot_bridge']),
        ('share/waam_robot_bridge', ['package.xml']),
        ('share/waam_robot_bridge/config', ['config/bridge.yaml']),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},  # colcon test runs them
    maintainer='WAAM maintainers',
    maintainer_email='maintainers@waam.invalid',
    description='The bridge to a robot: the controller core in front of a trajectory controller',
    license='Apache-2.0',
    entry_points={'console_scripts': ['robot_bridge = waam_robot_bridge.robot_bridge_node:main']},
)
