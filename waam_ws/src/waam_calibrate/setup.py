from setuptools import find_packages, setup

setup(
    name='waam_calibrate',
    version='0.3.0',
    packages=find_packages(exclude=['test']),
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/waam_calibrate']),
        ('share/waam_calibrate', ['package.xml']),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},  # colcon test runs them
    maintainer='WAAM maintainers',
    maintainer_email='maintainers@waam.invalid',
    description='Calibration of the machine: resonance and input shaper, steps, skew, tool centre point',
    license='Apache-2.0',
)
