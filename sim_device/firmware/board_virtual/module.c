/* An empty Python module, so that Python's build tools build and install core and virtual board.
 * Its file is the shared library that sim_device/core/chip.py loads. */
#include <Python.h>

PyMODINIT_FUNC PyInit_core_library(void);

PyMODINIT_FUNC PyInit_core_library(void)
{
    static struct PyModuleDef definition = {PyModuleDef_HEAD_INIT, .m_name = "core_library"};
    return PyModule_Create(&definition);
}
