from setuptools import find_packages, setup

setup(
    name='waam_adapt',
    version='0.3.0',
    packages=find_packages(exclude=['test']),
    package_data={'waam_adapt': ['models/*']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/waam_adapt']),
        ('share/waam_adapt', ['package.xml']),
        (
            'share/waam_adapt/config',
            [
                'config/correction_server.yaml',
                'config/feed_forward.yaml',
                'config/process_control.yaml',
                'config/thermal_compensator.yaml',
            ],
        ),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},  # colcon test runs them
    entry_points={
        'console_scripts': [
            'correction_server = waam_adapt.correction_server_node:main',
            'feed_forward = waam_adapt.feed_forward_node:main',
            'process_control = waam_adapt.process_control_node:main',
            'thermal_compensator = waam_adapt.thermal_compensator_node:main',
        ]
    },
    maintainer='WAAM maintainers',
    maintainer_email='maintainers@waam.invalid',
    description='Correction of the next layer from the scan of the last',
    license='Apache-2.0',
)
