from setuptools import find_packages, setup

setup(
    name='waam_view',
    version='0.3.0',
    packages=find_packages(exclude=['test']),
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/waam_view']),
        ('share/waam_view', ['package.xml']),
        ('share/waam_view/config', ['config/dashboard.yaml']),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},  # colcon test runs them
    entry_points={'console_scripts': ['dashboard = waam_view.dashboard_node:main']},
    maintainer='WAAM maintainers',
    maintainer_email='maintainers@waam.invalid',
    description='Rerun dashboard and job report of the WAAM cell',
    license='Apache-2.0',
)
