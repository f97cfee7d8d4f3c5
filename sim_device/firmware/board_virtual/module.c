/* Makes core and virtual board a module that Python's build tools build and install: it is empty, and
 * its file is the shared library (sim_device/core/chip.py). */
#include <Python.h>

PyMODINIT_FUNC PyInit_core_library(void);

PyMODINIT_FUNC PyInit_core_library(void)
{
    static struct PyModuleDef definition = {PyModuleDef_HEAD_INIT, .m_name = "core_library"};
    return PyModule_Create(&definition);
}
