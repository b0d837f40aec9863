"""Kernels compiled ahead: numba's machine code, linked into one extension module that needs neither numba nor LLVM.

`python -m mbf_relay.kernel_build FOLDER` is run when the package is built. What it makes, `_kernels`, is what
`mbf_relay.kernels.kernel` looks into first.
"""
