from glob import glob

from setuptools import find_packages, setup

setup(
    name='waam_panel',
    version='0.3.0',
    packages=find_packages(exclude=['test']),
    package_data={'waam_panel': ['*.yaml', 'static/*']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/waam_panel']),
        ('share/waam_panel', ['package.xml']),
        ('share/waam_panel/config', glob('config/*')),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},  # colcon test runs them
    entry_points={
        'console_scripts': [
            'panel = waam_panel.panel_node:main',
            'stop_lane = waam_panel.stop_lane:main',
        ]
    },
    maintainer='WAAM maintainers',
    maintainer_email='maintainers@waam.invalid',
    description='Operator panel of the WAAM cell: one web page to run a shift with',
    license='Apache-2.0',
)
