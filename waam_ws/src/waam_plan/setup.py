from setuptools import find_packages, setup

setup(
    name='waam_plan',
    version='0.3.0',
    packages=find_packages(exclude=['test']),
    package_data={
        'waam_plan.import_gcode': ['dialects/*.yaml'],
        'waam_plan.preview': ['page.css', 'page.js'],
    },
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/waam_plan']),
        ('share/waam_plan', ['package.xml']),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},  # colcon test runs them
    maintainer='WAAM maintainers',
    maintainer_email='maintainers@waam.invalid',
    description='Part to layers to segments to program: restoration, builds, scan passes, posts',
    license='Apache-2.0',
)
