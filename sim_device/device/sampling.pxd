cdef class Sampler:
    cdef object _imu_scale, _corrections, _sensors, _zero, _around, _contacts
    cdef bint _begun
    cdef public object counts, imu, imu_nominal
    cdef public long long imu_samples, imu_us

    cpdef object begin(self, long long now_us)
    cpdef object contacts(self)
    cpdef object power(self)
