from cpython.object cimport PyObject, PyTypeObject
from cpython.tuple cimport PyTuple_GET_SIZE, PyTuple_GetSlice


cdef inline object make(type cls, tuple values):
    arguments = (values,)
    return (<PyTypeObject *>tuple).tp_new(cls, <PyObject *>arguments, NULL)


cdef inline tuple values_of(object instance):
    return PyTuple_GetSlice(instance, 0, PyTuple_GET_SIZE(instance))


cdef inline bytes cut(const unsigned char *buffer, Py_ssize_t begin, Py_ssize_t end):
    return buffer[begin:end]
