"""Tell catkin where the Python package lies."""

from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import find_packages, setup

setup(
    **generate_distutils_setup(
        packages=find_packages("src"), package_dir={"": "src"},
        package_data={"mbf_relay": ["py.typed"], "mbf_relay.ros.web": ["page/*"]},  # the second is what web_view serves
    )
)
