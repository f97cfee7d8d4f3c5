cdef class Standstill:
    cdef public bint at_rest
    cdef double _last_count_s, _batch_sum
    cdef object _tuning, _last_encoder_s, _previous_mean
    cdef int _samples, _batch_count

    cpdef object on_gyro(self, double t_s, double rate_rad_s, double bias_rad_s)
    cpdef bint wheels_stand(self, double t_s)
