# The arrays that kernels take, C-contiguous; `typings/` says the same to mypy.

ctypedef double[::1] Floats
ctypedef double[:, ::1] FloatGrid
ctypedef double[:, :, ::1] FloatBlock
ctypedef float[::1] Singles
ctypedef int[::1] Ints
ctypedef int[:, ::1] IntGrid
ctypedef long long[::1] Longs
ctypedef long long[:, ::1] LongGrid
ctypedef long long[:, :, ::1] LongBlock
ctypedef unsigned char[::1] Bytes
ctypedef const unsigned char[::1] ConstBytes
ctypedef unsigned char[:, ::1] Layer

# What cfuncs return without making a Python object.
ctypedef (double, double) Pair
ctypedef (double, double, double, double) Four
