// A pad of fmfts-daemon as a force-torque sensor of ros2_control: the interfaces NAME/force.x to NAME/torque.z that
// semantic_components::ForceTorqueSensor and force_torque_sensor_broadcaster read. MIT licence.
#include <array>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include <hardware_interface/handle.hpp>
#include <hardware_interface/hardware_info.hpp>
#include <hardware_interface/sensor_interface.hpp>
#include <pluginlib/class_list_macros.hpp>
#include <rclcpp/rclcpp.hpp>
#include <rclcpp_lifecycle/state.hpp>

#include <fmfts.h>

namespace fmfts_hardware {

using hardware_interface::CallbackReturn;

constexpr double UNKNOWN = std::numeric_limits<double>::quiet_NaN();
const std::array<const char *, 6> PARTS = {"force.x", "force.y", "force.z", "torque.x", "torque.y", "torque.z"};

// What is not known is NaN, and so is everything while the pad may not be acted upon: a controller must look for it.
class PadSensor : public hardware_interface::SensorInterface {
public:
    CallbackReturn on_init(const hardware_interface::HardwareInfo &info) override
    {
        if (hardware_interface::SensorInterface::on_init(info) != CallbackReturn::SUCCESS)
            return CallbackReturn::ERROR;
        if (info_.sensors.size() != 1) {
            RCLCPP_ERROR(logger(), "%s: it has %zu sensors; give each pad a <ros2_control> of its own", info_.name.c_str(),
                         info_.sensors.size());
            return CallbackReturn::ERROR;
        }
        pad_ = parameter("pad", info_.sensors[0].name);
        endpoint_ = parameter("endpoint", "");
        try {
            height_m_ = std::stod(parameter("height_m", "0.012"));
        } catch (const std::exception &) {
            RCLCPP_ERROR(logger(), "%s: height_m is no number: it is z of the resting magnet", info_.name.c_str());
            return CallbackReturn::ERROR;
        }
        unknown_shear_n_ = parameter("unknown_shear", "nan") == "zero" ? 0.0 : UNKNOWN;
        return CallbackReturn::SUCCESS;
    }

    std::vector<hardware_interface::StateInterface> export_state_interfaces() override
    {
        std::vector<hardware_interface::StateInterface> interfaces;
        for (size_t part = 0; part < PARTS.size(); ++part)
            interfaces.emplace_back(info_.sensors[0].name, PARTS[part], &wrench_[part]);
        return interfaces;
    }

    CallbackReturn on_configure(const rclcpp_lifecycle::State &) override
    {
        char why[FMFTS_TEXT_SIZE];
        client_.reset(fmfts_connect(pad_.c_str(), endpoint_.empty() ? nullptr : endpoint_.c_str(), why));
        if (!client_) {
            RCLCPP_ERROR(logger(), "%s: %s", pad_.c_str(), why);
            return CallbackReturn::ERROR;
        }
        wrench_.fill(UNKNOWN);
        return CallbackReturn::SUCCESS;
    }

    CallbackReturn on_cleanup(const rclcpp_lifecycle::State &) override
    {
        client_.reset();
        return CallbackReturn::SUCCESS;
    }

    hardware_interface::return_type read(const rclcpp::Time &, const rclcpp::Duration &) override
    {
        const enum fmfts_result result = fmfts_latest(client_.get(), &contact_, 0);
        if (result == FMFTS_WRONG_VERSION || result == FMFTS_FAILED)
            return hardware_interface::return_type::ERROR;
        if (!fmfts_valid(client_.get()))
            wrench_.fill(UNKNOWN);
        else if (result == FMFTS_NEW)
            tell();
        return hardware_interface::return_type::OK;
    }

private:
    // In the pad's axes, about the middle of its sensors: a finger that presses pushes along -z.
    void tell()
    {
        wrench_.fill(0.0);
        wrench_[2] = -contact_.force_n.value;
        if (contact_.contact != FMFTS_TOUCHED)
            return;
        const double x_m = contact_.x_m.value, y_m = contact_.y_m.value;
        wrench_[0] = contact_.shear_x_n.known ? contact_.shear_x_n.value : unknown_shear_n_;
        wrench_[1] = contact_.shear_y_n.known ? contact_.shear_y_n.value : unknown_shear_n_;
        wrench_[3] = y_m * wrench_[2] - height_m_ * wrench_[1];
        wrench_[4] = height_m_ * wrench_[0] - x_m * wrench_[2];
        wrench_[5] = x_m * wrench_[1] - y_m * wrench_[0];
    }

    std::string parameter(const std::string &name, const std::string &otherwise) const
    {
        const auto found = info_.hardware_parameters.find(name);
        return found == info_.hardware_parameters.end() ? otherwise : found->second;
    }

    static rclcpp::Logger logger() { return rclcpp::get_logger("fmfts_hardware"); }

    struct Close {
        void operator()(fmfts_client *client) const { fmfts_close(client); }
    };
    std::unique_ptr<fmfts_client, Close> client_;
    struct fmfts_contact contact_ {};
    std::string pad_, endpoint_;
    double height_m_ = UNKNOWN, unknown_shear_n_ = UNKNOWN;
    std::array<double, 6> wrench_{};
};

}  // namespace fmfts_hardware

PLUGINLIB_EXPORT_CLASS(fmfts_hardware::PadSensor, hardware_interface::SensorInterface)
