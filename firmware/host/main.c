// fmfts-host: the firmware core on a pty, over emulated chips, in real time.
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <getopt.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "commands.h"

enum { SECOND_NS = 1000000000 };
// A busy computer may stop this process for seconds; the board then catches up, because a real board's clock never
// stops. After a longer stop (the computer was suspended) it does not catch up.
static const uint64_t LONGEST_DEBT_NS = 10ULL * SECOND_NS;

static const char usage[] =
    "usage: fmfts-host [--pads N] [--array] [--uid HEX24] [--link PATH] [--speed FACTOR | --stepped]\n"
    "Streams an emulated board on a pty, whose path it prints, until standard input closes or SIGTERM comes.\n"
    "  --pads N        pads on the board, 1 to 3 (1)\n"
    "  --array         the first pad has eight chips, on all channels of its mux; then at most 2 pads. The board finds\n"
    "                  two pads of four there, until a host asks for one of eight (firmware/wire.md, hello)\n"
    "  --uid HEX24     the board's 96-bit id (686f73740000000000000001)\n"
    "  --link PATH     make PATH a symbolic link to the pty, and remove it at the end\n"
    "  --speed FACTOR  board seconds per second, 0.01 to 20 (1)\n"
    "  --stepped       time passes only by the command `run`, so a busy computer delays nothing\n";

struct options {
    uint8_t pads;
    bool array;
    uint8_t uid[WIRE_UID_SIZE];
    const char *link;
    double speed;
    bool stepped;
};

// How the board's time follows the computer's.
struct pace {
    double speed;
    uint64_t passed_ns; // CLOCK_MONOTONIC up to which the board has run
};

static volatile sig_atomic_t terminated;

static void on_signal(int number)
{
    (void)number;
    terminated = 1;
}

static _Noreturn void refuse(const char *option, const char *value, const char *expected)
{
    fprintf(stderr, "fmfts-host: --%s %s: expected %s\n", option, value, expected);
    exit(2);
}

static void parse_uid(const char *text, uint8_t uid[WIRE_UID_SIZE])
{
    if (strlen(text) != 2 * WIRE_UID_SIZE || strspn(text, "0123456789abcdefABCDEF") != 2 * WIRE_UID_SIZE)
        refuse("uid", text, "24 hex digits");
    for (int i = 0; i < WIRE_UID_SIZE; i++) {
        const char digits[3] = {text[2 * i], text[2 * i + 1], '\0'};
        uid[i] = (uint8_t)strtoul(digits, NULL, 16);
    }
}

static double parse_number(const char *option, const char *text, double low, double high, const char *expected)
{
    char *end;
    double value = strtod(text, &end);
    if (end == text || *end != '\0' || !(value >= low && value <= high))
        refuse(option, text, expected);
    return value;
}

static struct options parse_options(int count, char **words)
{
    static const struct option known[] = {
        {"pads", required_argument, NULL, 'p'},  {"uid", required_argument, NULL, 'u'},
        {"link", required_argument, NULL, 'l'},  {"speed", required_argument, NULL, 's'},
        {"stepped", no_argument, NULL, 'S'},     {"array", no_argument, NULL, 'a'},
        {"help", no_argument, NULL, 'h'},        {NULL, 0, NULL, 0},
    };
    struct options options = {.pads = 1, .uid = {'h', 'o', 's', 't', [11] = 1}, .speed = 1.0};
    for (int option; (option = getopt_long(count, words, "", known, NULL)) != -1;) {
        if (option == 'p')
            options.pads = (uint8_t)parse_number("pads", optarg, 1, SAMPLER_PADS_MAX, "1, 2 or 3");
        else if (option == 'u')
            parse_uid(optarg, options.uid);
        else if (option == 'l')
            options.link = optarg;
        else if (option == 's')
            options.speed = parse_number("speed", optarg, 0.01, 20, "a factor from 0.01 to 20");
        else if (option == 'S')
            options.stepped = true;
        else if (option == 'a')
            options.array = true;
        else {
            fprintf(option == 'h' ? stdout : stderr, "%s%s", usage, option == 'h' ? commands_help : "");
            exit(option == 'h' ? 0 : 2);
        }
    }
    if (options.array && options.pads > 2)
        refuse("pads", "3", "1 or 2 beside --array: a board keeps twelve sensors");
    if (optind < count)
        refuse("", words[optind], "no further words");
    return options;
}

// Replaces only a symbolic link: a mistyped path must not delete a file.
static int make_link(const char *target, const char *path)
{
    struct stat found;
    if (lstat(path, &found) == 0 && S_ISLNK(found.st_mode))
        unlink(path);
    return symlink(target, path);
}

static void remove_link(const char *target, const char *path)
{
    char pointed[sizeof((struct line *)0)->path];
    ssize_t count = readlink(path, pointed, sizeof pointed);
    if (count > 0 && (size_t)count == strlen(target) && memcmp(pointed, target, (size_t)count) == 0)
        unlink(path);
}

// Drops the answer when stdout is full: a parent that does not read answers must not stop the stream.
static void say(const char *word, const char *rest)
{
    struct pollfd out = {.fd = STDOUT_FILENO, .events = POLLOUT};
    if (poll(&out, 1, 0) == 1 && (out.revents & POLLOUT)) {
        printf("%s%s\n", word, rest);
        fflush(stdout);
    }
}

static void execute_line(struct session *session, char *command)
{
    const char *wrong = commands_execute(session, command);
    say(wrong ? "error: " : "ok", wrong ? wrong : session->answer);
}

static uint64_t monotonic_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * SECOND_NS + (uint64_t)now.tv_nsec;
}

static void sleep_until(uint64_t ns)
{
    const struct timespec until = {(time_t)(ns / SECOND_NS), (long)(ns % SECOND_NS)};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL);
}

// Runs the board up to the computer's time. While that time is held, the board only serves the line.
static void catch_up(struct session *session, struct pace *pace)
{
    const uint64_t now_ns = monotonic_ns();
    if (session->stepped)
        return;
    if (session->held) {
        line_flush(&session->line);
        return;
    }
    if (now_ns > pace->passed_ns + LONGEST_DEBT_NS)
        pace->passed_ns = now_ns;
    while (pace->passed_ns < now_ns) {
        uint64_t left_ns = now_ns - pace->passed_ns, tick_ns = left_ns < TICK_NS ? left_ns : TICK_NS;
        session_pass(session, (uint64_t)((double)tick_ns * pace->speed));
        pace->passed_ns += tick_ns;
    }
}

// Executes the commands that have arrived; with --stepped it waits for one. False: standard input is closed.
static bool take_commands(struct session *session, struct pace *pace)
{
    static char text[8192];
    static size_t kept;
    struct pollfd in = {.fd = STDIN_FILENO, .events = POLLIN};
    if (poll(&in, 1, session->stepped ? -1 : 0) != 1)
        return true;
    ssize_t count = read(STDIN_FILENO, text + kept, sizeof text - kept);
    if (count <= 0)
        return count < 0 && (errno == EAGAIN || errno == EINTR);
    kept += (size_t)count;
    char *begin = text, *end;
    while ((end = memchr(begin, '\n', kept)) != NULL && !session->quit) {
        *end = '\0';
        kept -= (size_t)(end + 1 - begin);
        catch_up(session, pace); // on a busy computer the board may be behind; a command must not change its past
        execute_line(session, begin);
        begin = end + 1;
    }
    memmove(text, begin, kept);
    if (kept == sizeof text) {
        kept = 0;
        say("error: ", "a line longer than 8191 bytes was thrown away");
    }
    return true;
}

static void stream(struct session *session, double speed)
{
    struct pace pace = {speed, monotonic_ns()};
    while (!terminated && !session->quit && take_commands(session, &pace)) {
        catch_up(session, &pace);
        if (!session->stepped)
            sleep_until(monotonic_ns() + TICK_NS);
    }
}

int main(int count, char **words)
{
    static struct session session;
    const struct options options = parse_options(count, words);
    const struct sigaction action = {.sa_handler = on_signal};
    sigaction(SIGTERM, &action, NULL);
    sigaction(SIGINT, &action, NULL);
    signal(SIGPIPE, SIG_IGN);
    if (line_open(&session.line) < 0) {
        fprintf(stderr, "fmfts-host: cannot open a pty: %s\n", strerror(errno));
        return 1;
    }
    if (options.link && make_link(session.line.path, options.link) < 0) {
        fprintf(stderr, "fmfts-host: cannot make the link %s: %s\n", options.link, strerror(errno));
        return 1;
    }
    emulation_init(&session.emulation, options.pads, options.uid, line_send, &session.line);
    if (options.array)
        emulation_fill_switch(&session.emulation);
    session.stepped = options.stepped;
    say("pty: ", session.line.path);
    stream(&session, options.speed);
    if (options.link)
        remove_link(session.line.path, options.link);
    return 0;
}
