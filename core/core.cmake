# The only list of the core's sources: the Python extension, the C tests and, later, firmware and
# FMU take it from here.
set(ANHYST_CORE_DIR "${CMAKE_CURRENT_LIST_DIR}")
set(ANHYST_CORE_SOURCES
  "${ANHYST_CORE_DIR}/src/numeric/elementary.c"
  "${ANHYST_CORE_DIR}/src/law/langevin.c"
  "${ANHYST_CORE_DIR}/src/law/branch.c"
  "${ANHYST_CORE_DIR}/src/law/operator.c"
  "${ANHYST_CORE_DIR}/src/law/lag_exact.c"
  "${ANHYST_CORE_DIR}/src/law/lag_linear.c"
  "${ANHYST_CORE_DIR}/src/law/lag_1986.c"
  "${ANHYST_CORE_DIR}/src/law/solver.c"
  "${ANHYST_CORE_DIR}/src/law/cell_shape.c"
  "${ANHYST_CORE_DIR}/src/law/cell_table.c"
  "${ANHYST_CORE_DIR}/src/law/cells.c"
  "${ANHYST_CORE_DIR}/src/law/cell_sensitivity.c"
  "${ANHYST_CORE_DIR}/src/law/law_lag.c"
  "${ANHYST_CORE_DIR}/src/law/law_cells.c"
  "${ANHYST_CORE_DIR}/src/law/layers.c"
  "${ANHYST_CORE_DIR}/src/law/circuit.c"
  "${ANHYST_CORE_DIR}/src/law/settle.c"
  "${ANHYST_CORE_DIR}/src/law/sensitivity.c"
  "${ANHYST_CORE_DIR}/src/law/batch_dispatch.c"
  "${ANHYST_CORE_DIR}/src/compensator/block.c"
  "${ANHYST_CORE_DIR}/src/compensator/block_f32.c"
  "${ANHYST_CORE_DIR}/src/compensator/block_f64.c"
  "${ANHYST_CORE_DIR}/src/compensator/full.c"
  "${ANHYST_CORE_DIR}/src/compensator/cells.c"
  "${ANHYST_CORE_DIR}/src/compensator/simplified.c"
  "${ANHYST_CORE_DIR}/src/compensator/euler.c"
  "${ANHYST_CORE_DIR}/src/compensator/compensator.c"
  "${ANHYST_CORE_DIR}/src/compensator/full_f32.c"
  "${ANHYST_CORE_DIR}/src/compensator/full_f64.c"
  "${ANHYST_CORE_DIR}/src/compensator/cells_f32.c"
  "${ANHYST_CORE_DIR}/src/compensator/cells_f64.c"
  "${ANHYST_CORE_DIR}/src/compensator/simplified_f32.c"
  "${ANHYST_CORE_DIR}/src/compensator/simplified_f64.c"
  "${ANHYST_CORE_DIR}/src/compensator/compensator_f32.c"
  "${ANHYST_CORE_DIR}/src/compensator/compensator_f64.c"
  "${ANHYST_CORE_DIR}/src/compensator/watch.c"
  "${ANHYST_CORE_DIR}/src/compensator/watch_f32.c"
  "${ANHYST_CORE_DIR}/src/compensator/watch_f64.c"
  "${ANHYST_CORE_DIR}/src/compensator/saved.c"
  "${ANHYST_CORE_DIR}/src/compensator/saved_f32.c"
  "${ANHYST_CORE_DIR}/src/compensator/saved_f64.c"
  "${ANHYST_CORE_DIR}/src/control/coil_flux.c"
  "${ANHYST_CORE_DIR}/src/control/coil_flux_f32.c"
  "${ANHYST_CORE_DIR}/src/control/coil_flux_f64.c"
  "${ANHYST_CORE_DIR}/src/control/pidd2.c"
  "${ANHYST_CORE_DIR}/src/control/pidd2_f32.c"
  "${ANHYST_CORE_DIR}/src/control/pidd2_f64.c"
  "${ANHYST_CORE_DIR}/src/compensator/map.c"
  "${ANHYST_CORE_DIR}/src/compensator/map_f32.c"
  "${ANHYST_CORE_DIR}/src/compensator/map_f64.c"
  "${ANHYST_CORE_DIR}/src/compensator/play_map.c"
  "${ANHYST_CORE_DIR}/src/compensator/play_map_f32.c"
  "${ANHYST_CORE_DIR}/src/compensator/play_map_f64.c"
  "${ANHYST_CORE_DIR}/src/compensator/force_controller.c"
  "${ANHYST_CORE_DIR}/src/compensator/force_controller_f32.c"
  "${ANHYST_CORE_DIR}/src/compensator/force_controller_f64.c"
  "${ANHYST_CORE_DIR}/src/compensator/force_by_play.c"
  "${ANHYST_CORE_DIR}/src/compensator/force_by_play_f32.c"
  "${ANHYST_CORE_DIR}/src/compensator/force_by_play_f64.c"
  "${ANHYST_CORE_DIR}/src/compensator/force_corrected_f32.c"
  "${ANHYST_CORE_DIR}/src/compensator/force_corrected_f64.c"
  "${ANHYST_CORE_DIR}/src/compensator/force_coded_f32.c"
  "${ANHYST_CORE_DIR}/src/compensator/force_coded_f64.c"
  "${ANHYST_CORE_DIR}/src/control/supervisor.c"
  "${ANHYST_CORE_DIR}/src/control/levitation.c"
  "${ANHYST_CORE_DIR}/src/control/position.c"
  "${ANHYST_CORE_DIR}/src/control/position_f32.c"
  "${ANHYST_CORE_DIR}/src/control/position_f64.c"
  "${ANHYST_CORE_DIR}/src/control/biquad_f32.c"
  "${ANHYST_CORE_DIR}/src/control/biquad_f64.c"
  "${ANHYST_CORE_DIR}/src/control/allocation.c"
  "${ANHYST_CORE_DIR}/src/control/allocation_f32.c"
  "${ANHYST_CORE_DIR}/src/control/allocation_f64.c"
  "${ANHYST_CORE_DIR}/src/control/tracking.c"
  "${ANHYST_CORE_DIR}/src/control/wrench_f32.c"
  "${ANHYST_CORE_DIR}/src/control/wrench_f64.c"
  "${ANHYST_CORE_DIR}/src/control/wrench_fixed.c"
  "${ANHYST_CORE_DIR}/src/control/axes_f32.c"
  "${ANHYST_CORE_DIR}/src/control/axes_f64.c"
  "${ANHYST_CORE_DIR}/src/control/axes_fixed.c")

set(ANHYST_WARNINGS
  -Wall -Wextra -Wpedantic -Wconversion -Wdouble-promotion -Wshadow -Werror)

# No product fused into a sum: the same bits with every compiler and on every processor.
set(ANHYST_SAME_BITS -ffp-contract=off)

# The batch is compiled once for each instruction set; batch_dispatch.c picks one at run time.
set(ANHYST_BATCH_OBJECTS)
function(anhyst_batch name)
  add_library(anhyst_batch_${name} OBJECT "${ANHYST_CORE_DIR}/src/law/batch.c")
  target_include_directories(anhyst_batch_${name} PRIVATE "${ANHYST_CORE_DIR}/include")
  target_compile_definitions(anhyst_batch_${name} PRIVATE ANHYST_BATCH_NAME=_${name})
  target_compile_options(anhyst_batch_${name} PRIVATE -O3 ${ANHYST_WARNINGS}
    -fno-math-errno -fno-trapping-math ${ANHYST_SAME_BITS} ${ARGN})
  set_target_properties(anhyst_batch_${name} PROPERTIES
    C_STANDARD 99 C_STANDARD_REQUIRED ON C_EXTENSIONS OFF POSITION_INDEPENDENT_CODE ON
  C_VISIBILITY_PRESET hidden)
  set(ANHYST_BATCH_OBJECTS ${ANHYST_BATCH_OBJECTS} $<TARGET_OBJECTS:anhyst_batch_${name}>
    PARENT_SCOPE)
endfunction()
anhyst_batch(base)
if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
  anhyst_batch(avx2 -mavx2 -mfma)
  anhyst_batch(avx512 -mavx512f -mavx512dq -mavx512vl -mfma -mprefer-vector-width=512)
endif()

add_library(anhyst_core STATIC ${ANHYST_CORE_SOURCES} ${ANHYST_BATCH_OBJECTS})
if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
  target_compile_definitions(anhyst_core PRIVATE ANHYST_BATCH_X86)
endif()
# Room for four layers of solid iron and what is laminated.
target_compile_definitions(anhyst_core PUBLIC ANHYST_MEMORIES=5)
target_include_directories(anhyst_core
  PUBLIC "${ANHYST_CORE_DIR}/include" PRIVATE "${ANHYST_CORE_DIR}/src")
set_target_properties(anhyst_core PROPERTIES
  C_STANDARD 99 C_STANDARD_REQUIRED ON C_EXTENSIONS OFF POSITION_INDEPENDENT_CODE ON
  C_VISIBILITY_PRESET hidden)
target_compile_options(anhyst_core PRIVATE
  -O3 -fno-math-errno ${ANHYST_SAME_BITS} ${ANHYST_WARNINGS})
if(UNIX)
  target_link_libraries(anhyst_core PUBLIC m)
endif()
