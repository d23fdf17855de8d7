from glob import glob

from setuptools import find_packages, setup

setup(
    name='waam_sim',
    version='0.3.0',
    packages=find_packages(exclude=['test']),
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/waam_sim']),
        ('share/waam_sim', ['package.xml']),
        ('share/waam_sim/config', ['config/cell.yaml']),
        ('share/waam_sim/config/presets', glob('config/presets/*.yaml')),
        ('share/waam_sim/urdf', ['urdf/small_arm.urdf']),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},  # colcon test runs them
    entry_points={
        'console_scripts': [
            'cell = waam_sim.cell_node:main',
            'robot_cell = waam_sim.robot_cell_node:main',
        ]
    },
    maintainer='WAAM maintainers',
    maintainer_email='maintainers@waam.invalid',
    description='The simulated cell: metal, heat, arc, wire, line scanner, pyrometer and their faults',
    license='Apache-2.0',
)
