from setuptools import find_packages, setup

setup(
    name='waam_shop',
    version='0.3.0',
    packages=find_packages(exclude=['test']),
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/waam_shop']),
        ('share/waam_shop', ['package.xml']),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},  # colcon test runs them
    maintainer='WAAM maintainers',
    maintainer_email='maintainers@waam.invalid',
    description='Many cells: queue of jobs, roles and tokens, audit log, messages to people',
    license='Apache-2.0',
)
