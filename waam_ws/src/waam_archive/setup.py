from setuptools import find_packages, setup

setup(
    name='waam_archive',
    version='0.3.0',
    packages=find_packages(exclude=['test']),
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/waam_archive']),
        ('share/waam_archive', ['package.xml']),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},  # colcon test runs them
    maintainer='WAAM maintainers',
    maintainer_email='maintainers@waam.invalid',
    description='Archive of all jobs: DuckDB over Parquet, control charts, key figures, traceability',
    license='Apache-2.0',
)
