from setuptools import find_packages, setup

setup(
    name='waam_robot',
    version='0.3.0',
    packages=find_packages(exclude=['test']),
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/waam_robot']),
        ('share/waam_robot', ['package.xml']),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},  # colcon test runs them
    maintainer='WAAM maintainers',
    maintainer_email='maintainers@waam.invalid',
    description='Robot arms and positioners: kinematics, motion split, planning of joint paths',
    license='Apache-2.0',
)
