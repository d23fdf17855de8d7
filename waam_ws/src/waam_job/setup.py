from glob import glob

from setuptools import find_packages, setup

setup(
    name='waam_job',
    version='0.3.0',
    packages=find_packages(exclude=['test']),
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/waam_job']),
        ('share/waam_job', ['package.xml']),
        ('share/waam_job/config', glob('config/*')),
    ],
    entry_points={'console_scripts': ['job_sequencer = waam_job.job_sequencer_node:main']},
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},  # colcon test runs them
    maintainer='WAAM maintainers',
    maintainer_email='maintainers@waam.invalid',
    description='The job: layer loop, interlocks, checkpoint, report data',
    license='Apache-2.0',
)
