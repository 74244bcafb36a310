// A servo loop as CHAI3D, OpenHaptics or a driver of one's own have it: a thread reads a
// position, asks a stimulus for the force, and writes it, 4000 times a second. The stimulus is
// a compiled processor or exported C; the loop does not know which.
//
// The device is made up: a mass on the spring and damper of a hand that moves to and fro. What
// it did and what it was given are kept, so that both can be compared later.
#include "stimlib.h"
#include <atomic>
#include <chrono>
#include <cmath>
#include <thread>
#include <vector>

namespace {

struct Device {  // semi-implicit Euler at the rate of the loop
    double x = 0.0, v = 0.0, t = 0.0;
    double position() const { return x; }
    void write(double force, double step)
    {
        const double hand = 0.01 * (1.0 - std::cos(2.0 * M_PI * 2.0 * t));
        v += step * (400.0 * (hand - x) - 4.0 * v - force) / 0.1;
        x += step * v;
        t += step;
    }
};

struct Servo {
    std::thread thread;
    std::atomic<bool> running{true};
    std::atomic<double> wanted{-1.0};  // a value of parameter 0, from another thread
    std::vector<double> positions, forces;
    long late = 0, changed = -1;  // samples that came late; the sample at which it was set
};

void loop(Servo *servo, stimlib_process process, stimlib_set set, void *run, double rate, long most)
{
    using clock = std::chrono::steady_clock;
    const auto period = std::chrono::nanoseconds(static_cast<long>(1e9 / rate));
    Device device;
    auto next = clock::now();
    for (long i = 0; i < most && servo->running; i++) {
        const double value = servo->wanted.exchange(-1.0);
        if (value >= 0.0) {
            set(run, 0, value, std::round(0.01 * rate));
            servo->changed = i;
        }
        const double x = device.position();
        double force = 0.0;
        process(run, &x, &force, 1);
        servo->positions.push_back(x);
        servo->forces.push_back(force);
        device.write(force, 1.0 / rate);
        next += period;
        if (clock::now() > next) servo->late++;
        std::this_thread::sleep_until(next);
    }
}

}  // namespace

extern "C" {

// Start a loop of at most so many samples.
void *servo_start(stimlib_process process, stimlib_set set, void *run, double rate, long most)
{
    Servo *servo = new Servo;
    servo->positions.reserve(most);  // the loop itself allocates nothing
    servo->forces.reserve(most);
    servo->thread = std::thread(loop, servo, process, set, run, rate, most);
    return servo;
}

// Let parameter 0 go to a value not below 0, from any thread.
void servo_want(void *servo, double value) { static_cast<Servo *>(servo)->wanted = value; }

// End the loop; return how many samples it made.
long servo_stop(void *servo)
{
    Servo *s = static_cast<Servo *>(servo);
    s->running = false;
    s->thread.join();
    return static_cast<long>(s->forces.size());
}

// Copy what the device did and was given; then forget the loop. Return how many samples came
// late, and the sample at which the parameter was set.
long servo_take(void *servo, double *positions, double *forces, long *changed)
{
    Servo *s = static_cast<Servo *>(servo);
    *changed = s->changed;
    for (size_t i = 0; i < s->forces.size(); i++) {
        positions[i] = s->positions[i];
        forces[i] = s->forces[i];
    }
    const long late = s->late;
    delete s;
    return late;
}

// For programs that link exported C themselves.
stimlib_set servo_set_of_processor(void) { return stimlib_set_processor; }
}
