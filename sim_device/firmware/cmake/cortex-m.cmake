# Toolchain for chips: cmake -DCMAKE_TOOLCHAIN_FILE=cmake/cortex-m.cmake. It needs arm-none-eabi-gcc and
# its newlib. CMakeLists.txt defines the processor of each board.
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_SYSTEM_PROCESSOR arm)
set(CMAKE_C_COMPILER arm-none-eabi-gcc)
set(CMAKE_OBJCOPY arm-none-eabi-objcopy)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)
