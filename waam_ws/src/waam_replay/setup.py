from setuptools import find_packages, setup

setup(
    name='waam_replay',
    version='0.3.0',
    packages=find_packages(exclude=['test']),
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/waam_replay']),
        ('share/waam_replay', ['package.xml']),
        ('share/waam_replay/config', ['config/player.yaml']),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},  # colcon test runs them
    entry_points={'console_scripts': ['player = waam_replay.player_node:main']},
    maintainer='WAAM maintainers',
    maintainer_email='maintainers@waam.invalid',
    description='Computes a recorded job again through the pure cores, or plays it to a graph',
    license='Apache-2.0',
)
