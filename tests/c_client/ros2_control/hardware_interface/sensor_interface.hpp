// Stand-ins for as much of ros2_control 4 (Jazzy) as clients/ros2/fmfts_hardware uses, with its names and signatures.
#pragma once
#include <cstdio>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

namespace rclcpp {
class Time {};
class Duration {};
struct Logger {};
inline Logger get_logger(const std::string &) { return {}; }
}
#define RCLCPP_ERROR(logger, ...) (static_cast<void>(logger), std::fprintf(stderr, __VA_ARGS__))
#define PLUGINLIB_EXPORT_CLASS(kind, base) static_assert(std::is_base_of<base, kind>::value, "it is a plug-in of this kind");
namespace rclcpp_lifecycle { class State {}; }

namespace hardware_interface {
enum class CallbackReturn { SUCCESS, FAILURE, ERROR };
enum class return_type { OK, ERROR };
struct ComponentInfo { std::string name; };
struct HardwareInfo {
    std::string name;
    std::unordered_map<std::string, std::string> hardware_parameters;
    std::vector<ComponentInfo> sensors;
};
class StateInterface {
public:
    StateInterface(const std::string &prefix, const std::string &name, double *value) : name_(prefix + "/" + name), value_(value) {}
    const std::string &get_name() const { return name_; }
    double get_value() const { return *value_; }

private:
    std::string name_;
    double *value_;
};
class SensorInterface {
public:
    virtual ~SensorInterface() = default;
    virtual CallbackReturn on_init(const HardwareInfo &info)
    {
        info_ = info;
        return CallbackReturn::SUCCESS;
    }
    virtual CallbackReturn on_configure(const rclcpp_lifecycle::State &) { return CallbackReturn::SUCCESS; }
    virtual CallbackReturn on_cleanup(const rclcpp_lifecycle::State &) { return CallbackReturn::SUCCESS; }
    virtual std::vector<StateInterface> export_state_interfaces() = 0;
    virtual return_type read(const rclcpp::Time &, const rclcpp::Duration &) = 0;

protected:
    HardwareInfo info_;
};
}
