cdef class TimeSync:
    cdef long long _min_up_ns, _min_down_ns
    cdef public object fit, steps
    cdef public long long samples, round_trip_ns
    cdef object _last, _contradictions
    cdef dict _upper, _lower
    cdef list _upper_corners, _lower_corners

    cpdef object reset(self)
    cpdef object extend(self, object low32)
    cpdef object observe(self, object low32, long long arrived_ns)
    cpdef object arrival(self, long long device_us, long long host_ns)
    cpdef bint exchange(
        self,
        long long sent_ns,
        long long received_us,
        long long replied_us,
        long long arrived_ns,
    )
    cpdef bint _is_future(self, long long device_us, long long arrived_ns)
    cpdef object map(self, long long device_us)
    cpdef bint _contradicts(
        self,
        long long sent_ns,
        long long received_us,
        long long replied_us,
        object arrived,
    )
