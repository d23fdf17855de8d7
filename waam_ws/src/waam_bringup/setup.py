from glob import glob

from setuptools import find_packages, setup

setup(
    name='waam_bringup',
    version='0.3.0',
    packages=find_packages(exclude=['test']),
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/waam_bringup']),
        ('share/waam_bringup', ['package.xml']),
        ('share/waam_bringup/config', glob('config/*')),
        ('share/waam_bringup/launch', glob('launch/*.py')),
        ('share/waam_bringup/parts', glob('parts/*')),
    ],
    entry_points={'console_scripts': ['waam = waam_bringup.entry:main']},
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},  # colcon test runs them
    maintainer='WAAM maintainers',
    maintainer_email='maintainers@waam.invalid',
    description='Starts the graph',
    license='Apache-2.0',
)
