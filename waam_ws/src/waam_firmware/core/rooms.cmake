# The rooms of the core: each folder is on the include path, so a header is included by its name alone.
set(WAAM_CORE_ROOMS common link gcode motion arc standoff accelerometer machine)
set(WAAM_CORE_SOURCES)
set(WAAM_CORE_INCLUDES)
foreach(room ${WAAM_CORE_ROOMS})
  file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_LIST_DIR}/${room}/*.c)
  list(APPEND WAAM_CORE_SOURCES ${sources})
  list(APPEND WAAM_CORE_INCLUDES ${CMAKE_CURRENT_LIST_DIR}/${room})
endforeach()
