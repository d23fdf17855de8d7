from setuptools import find_packages, setup

setup(
    name='waam_process',
    version='0.3.0',
    packages=find_packages(exclude=['test']),
    package_data={'waam_process': ['*.yaml']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/waam_process']),
        ('share/waam_process', ['package.xml']),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},  # colcon test runs them
    maintainer='WAAM maintainers',
    maintainer_email='maintainers@waam.invalid',
    description='What the metal does: bead, wire, heat, overlap; height grid and path segment',
    license='Apache-2.0',
)
