# The only list of the core's sources: the Python extension, the C tests and, later, firmware and
# FMU take it from here.
set(ANHYST_CORE_DIR "${CMAKE_CURRENT_LIST_DIR}")
set(ANHYST_CORE_SOURCES
  "${ANHYST_CORE_DIR}/src/langevin.c"
  "${ANHYST_CORE_DIR}/src/branch.c"
  "${ANHYST_CORE_DIR}/src/operator.c"
  "${ANHYST_CORE_DIR}/src/solver.c"
  "${ANHYST_CORE_DIR}/src/circuit.c")

add_library(anhyst_core STATIC ${ANHYST_CORE_SOURCES})
target_include_directories(anhyst_core
  PUBLIC "${ANHYST_CORE_DIR}/include" PRIVATE "${ANHYST_CORE_DIR}/src")
set_target_properties(anhyst_core PROPERTIES
  C_STANDARD 99 C_STANDARD_REQUIRED ON C_EXTENSIONS OFF POSITION_INDEPENDENT_CODE ON)
target_compile_options(anhyst_core PRIVATE
  -O3 -fno-math-errno -Wall -Wextra -Wpedantic -Wconversion -Wdouble-promotion -Wshadow -Werror)
if(UNIX)
  target_link_libraries(anhyst_core PUBLIC m)
endif()
