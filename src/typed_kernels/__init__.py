"""Numba kernels whose code is picked by the types of their arguments, with machine code kept on disk.

``jit``           decorators: kernels, helpers, and functions whose implementation a type selects
``compilers``     what becomes machine code, and what of it is written
``code_cache``    which machine code is read, when it is compiled again, where it is written
``code_files``    its files: written whole, read if undamaged and out of reach for other users
``shipped_code``  machine code that a wheel brings
``packages``      which packages have kernels; it loads no numba
``watching``      what is compiled now, for those who show it; it loads no numba

Nothing here knows what the kernels compute. A package of kernels is a folder of modules with decorated
functions. Modules import from each other, and from other such packages, by ``from ... import ...``: these
lines say which machine code is out of date after a change.
"""
