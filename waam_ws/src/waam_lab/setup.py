from setuptools import find_packages, setup

setup(
    name='waam_lab',
    version='0.3.0',
    packages=find_packages(exclude=['test']),
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/waam_lab']),
        ('share/waam_lab', ['package.xml']),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},  # colcon test runs them
    maintainer='WAAM maintainers',
    maintainer_email='maintainers@waam.invalid',
    description='The laboratory: whole jobs on the simulated cell in one process, many times faster than real time',
    license='Apache-2.0',
)
