#include <hardware_interface/sensor_interface.hpp>
