from sim_device.device.health cimport Health
from sim_device.device.latch cimport StopLatch
from sim_device.device.motor_drivers cimport MotorDrivers
from sim_device.device.sampling cimport Sampler
from sim_device.device.watchdog cimport DutyWatchdog, SetpointWatchdog


cdef class Control:
    cdef dict __dict__
    cdef public object modes, reflexes, onboard, power
    cdef public StopLatch latch
    cdef public SetpointWatchdog setpoints
    cdef public DutyWatchdog duties
    cdef public Health health
    cdef public MotorDrivers drivers
    cdef long long _now_us
    cdef object _log, _seed, _expired, _logged_bits, _base, _parameters, _model
    cdef double _supply_v, _low_v, _empty_v
    cdef public object wheels

    cpdef object apply_parameters(self)
    cpdef object planner_state(self)
    cpdef bint _is_prevented(self, object event)
    cpdef object _end_plan(self, object plan)
    cpdef object stop(self, object cause, object event=*)
    cpdef object _latch(self, object cause)
    cpdef object clear(self, object cause)
    cpdef object start(self, object number)
    cpdef object forget_host(self)
    cpdef object tick(self, long long tick, long long now_us, Sampler sampler, object around)
    cpdef object _drive(self, long long tick, long long now_us, Sampler sampler, object around)
    cpdef object _run(
        self,
        object plan,
        long long tick,
        long long now_us,
        Sampler sampler,
        object around,
    )
    cpdef object on_power(self, object reading)
    cpdef object check_power(self)
    cpdef object _judge(self)
    cpdef object _log_faults(self, object bits)
