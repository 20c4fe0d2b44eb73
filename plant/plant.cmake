# The only list of the virtual plant's sources. It stands on the core.
set(ANHYST_PLANT_DIR "${CMAKE_CURRENT_LIST_DIR}")
set(ANHYST_PLANT_SOURCES
  "${ANHYST_PLANT_DIR}/src/iron.c"
  "${ANHYST_PLANT_DIR}/src/irons/cells.c"
  "${ANHYST_PLANT_DIR}/src/irons/preisach.c"
  "${ANHYST_PLANT_DIR}/src/irons/duhem.c"
  "${ANHYST_PLANT_DIR}/src/solid.c"
  "${ANHYST_PLANT_DIR}/src/cone.c"
  "${ANHYST_PLANT_DIR}/src/magnet.c"
  "${ANHYST_PLANT_DIR}/src/sensor.c"
  "${ANHYST_PLANT_DIR}/src/held.c"
  "${ANHYST_PLANT_DIR}/src/body.c"
  "${ANHYST_PLANT_DIR}/src/loop.c"
  "${ANHYST_PLANT_DIR}/src/position.c"
  "${ANHYST_PLANT_DIR}/src/axes.c"
  "${ANHYST_PLANT_DIR}/src/piezo.c"
  "${ANHYST_PLANT_DIR}/src/bus.c")

add_library(anhyst_plant STATIC ${ANHYST_PLANT_SOURCES})
target_include_directories(anhyst_plant PUBLIC "${ANHYST_PLANT_DIR}/include")
target_link_libraries(anhyst_plant PUBLIC anhyst_core)
set_target_properties(anhyst_plant PROPERTIES
  C_STANDARD 99 C_STANDARD_REQUIRED ON C_EXTENSIONS OFF POSITION_INDEPENDENT_CODE ON
  C_VISIBILITY_PRESET hidden)
target_compile_options(anhyst_plant PRIVATE
  -O3 -fno-math-errno ${ANHYST_SAME_BITS} ${ANHYST_WARNINGS})
