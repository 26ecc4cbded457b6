"""sparsepop_py"""
from .polynomial import *
from .problem import *
from .errors import *
