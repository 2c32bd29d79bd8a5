// Reads a pad as ros2_control's manager would, and prints its interfaces as lines of JSON until its input ends. host PAD ENDPOINT
#include "../../../clients/ros2/fmfts_hardware/src/pad_sensor.cpp"

#include <cmath>
#include <poll.h>

int main(int, char **words)
{
    fmfts_hardware::PadSensor sensor;
    const hardware_interface::HardwareInfo info{
        "pad", {{"pad", words[1]}, {"endpoint", words[2]}, {"unknown_shear", "zero"}}, {{"tip"}}};
    if (sensor.on_init(info) != hardware_interface::CallbackReturn::SUCCESS ||
        sensor.on_configure({}) != hardware_interface::CallbackReturn::SUCCESS)
        return 1;
    const auto interfaces = sensor.export_state_interfaces();
    pollfd input{0, POLLIN, 0};
    while (poll(&input, 1, 2) == 0) {
        if (sensor.read({}, {}) != hardware_interface::return_type::OK)
            return 2;
        const char *between = "{";
        for (const auto &each : interfaces) {
            std::printf("%s\"%s\":", between, each.get_name().c_str());
            std::isnan(each.get_value()) ? std::printf("null") : std::printf("%.17g", each.get_value());
            between = ",";
        }
        std::printf("}\n");
        std::fflush(stdout);
    }
    sensor.on_cleanup({});
}
