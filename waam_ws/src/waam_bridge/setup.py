from setuptools import find_packages, setup

setup(
    name='waam_bridge',
    version='0.3.0',
    packages=find_packages(exclude=['test']),
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/waam_bridge']),
        ('share/waam_bridge', ['package.xml']),
        ('share/waam_bridge/config', ['config/bridge.yaml', 'config/pyrometer.yaml']),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},  # colcon test runs them
    maintainer='WAAM maintainers',
    maintainer_email='maintainers@waam.invalid',
    description='The host end of the link to the controller',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'bridge = waam_bridge.bridge_node:main',
            'pyrometer = waam_bridge.pyrometer_node:main',
        ]
    },
)
