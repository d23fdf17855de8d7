from setuptools import find_packages, setup

setup(
    name='waam_record',
    version='0.3.0',
    packages=find_packages(exclude=['test']),
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/waam_record']),
        ('share/waam_record', ['package.xml']),
        ('share/waam_record/config', ['config/recorder.yaml']),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},  # colcon test runs them
    entry_points={'console_scripts': ['recorder = waam_record.recorder_node:main']},
    maintainer='WAAM maintainers',
    maintainer_email='maintainers@waam.invalid',
    description='MCAP recorder of all topics with counted losses; check and recovery of recordings',
    license='Apache-2.0',
)
