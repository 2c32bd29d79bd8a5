// Reads a pad as ros2_control's manager would, and prints its interfaces as lines of JSON. host PAD ENDPOINT SECONDS
#include "../../../clients/ros2/fmfts_hardware/src/pad_sensor.cpp"

#include <chrono>
#include <cmath>
#include <thread>

int main(int, char **words)
{
    fmfts_hardware::PadSensor sensor;
    const hardware_interface::HardwareInfo info{
        "pad", {{"pad", words[1]}, {"endpoint", words[2]}, {"unknown_shear", "zero"}}, {{"tip"}}};
    if (sensor.on_init(info) != hardware_interface::CallbackReturn::SUCCESS ||
        sensor.on_configure({}) != hardware_interface::CallbackReturn::SUCCESS)
        return 1;
    const auto interfaces = sensor.export_state_interfaces();
    const auto until = std::chrono::steady_clock::now() + std::chrono::duration<double>(std::stod(words[3]));
    while (std::chrono::steady_clock::now() < until) {
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
        std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    sensor.on_cleanup({});
}
