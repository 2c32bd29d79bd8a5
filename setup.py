"""What depends on the Python that builds: the stable ABI of 3.11 serves every later Python (common/stable_abi.h).

A wheel that Python 3.10 builds serves 3.10 alone.
"""

import sys

from setuptools import setup

setup(options={"bdist_wheel": {"py_limited_api": "cp311"}} if sys.version_info >= (3, 11) else {})
