from setuptools import find_packages, setup

setup(
    name='waam_node',
    version='0.3.0',
    packages=find_packages(exclude=['test']),
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/waam_node']),
        ('share/waam_node', ['package.xml']),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},  # colcon test runs them
    maintainer='WAAM maintainers',
    maintainer_email='maintainers@waam.invalid',
    description='What every node of the graph shares: parameters, quality of service, heartbeat, diagnostics, spinning',
    license='Apache-2.0',
)
