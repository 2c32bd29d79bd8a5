// The same gripper in C++: it sleeps until a contact comes, and a unique_ptr owns the client.
#include <fmfts.h>

#include <chrono>
#include <iostream>
#include <memory>
#include <string>

namespace {

using std::chrono::steady_clock;
constexpr std::chrono::milliseconds calm{200};
constexpr double limit_n = 1.0;
constexpr double largest_force_sd_n = 0.5; // a force that is less certain does not close the gripper

struct Close {
    void operator()(fmfts_client *client) const { fmfts_close(client); }
};
using Client = std::unique_ptr<fmfts_client, Close>;

// Why the gripper must open; empty: it may close.
std::string why_open(const Client &client, const fmfts_contact &contact)
{
    char why[FMFTS_TEXT_SIZE];
    if (!fmfts_why_invalid(client.get(), why))
        return why;
    return contact.force_n.value > limit_n ? "pressed with " + std::to_string(contact.force_n.value) + " N" : "";
}

// The kind of a reason, without its numbers, which change with each contact.
std::string kind_of(const std::string &reason)
{
    std::string kind;
    for (const char letter : reason)
        if (letter != '.' && (letter < '0' || letter > '9'))
            kind += letter;
    return kind;
}

} // namespace

int main(int count, char **words)
{
    char why[FMFTS_TEXT_SIZE];
    const Client client(fmfts_connect(count > 1 ? words[1] : "demo", nullptr, why));
    if (!client) {
        std::cerr << "gripper: " << why << '\n';
        return 69;
    }
    fmfts_set_largest_force_sd(client.get(), largest_force_sd_n);
    fmfts_contact contact{};
    std::string printed = "-";
    steady_clock::time_point opened = steady_clock::now();
    fmfts_result result;
    while ((result = fmfts_latest(client.get(), &contact, FMFTS_ALIVE_MS)) >= 0) {
        const std::string reason = why_open(client, contact);
        if (!reason.empty())
            opened = steady_clock::now();
        else if (steady_clock::now() - opened < calm)
            continue;
        if (printed == kind_of(reason))
            continue;
        printed = kind_of(reason);
        // Your gripper's command goes here.
        std::cout << (reason.empty() ? "CLOSE" : "OPEN (" + reason + ")") << std::endl;
    }
    std::cout << "OPEN (" << fmfts_refusal(client.get()) << ")" << std::endl;
    return 69;
}
