from setuptools import find_packages, setup

setup(
    name='waam_scan',
    version='0.3.0',
    packages=find_packages(exclude=['test']),
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/waam_scan']),
        ('share/waam_scan', ['package.xml']),
        ('share/waam_scan/config', ['config/scan_fusion.yaml']),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},  # colcon test runs them
    maintainer='WAAM maintainers',
    maintainer_email='maintainers@waam.invalid',
    description='Laser profiles and machine pose to height maps with uncertainty',
    license='Apache-2.0',
    entry_points={'console_scripts': ['scan_fusion = waam_scan.scan_fusion_node:main']},
)
