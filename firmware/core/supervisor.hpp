// What state a module is in, and which event takes it where: one table, nothing else.
//
//            idle      armed     running   timeout   fault     estop
// arm        armed     refused   refused   refused   refused   refused
// set_point  refused   running   running   refused   refused   refused
// stop       idle      idle      idle      idle      refused   refused
// estop      estop     estop     estop     estop     estop     estop
// clear      idle      armed     running   timeout   idle      idle
// expire     idle      timeout   timeout   timeout   fault     estop
// fault      idle      fault     fault     fault     fault     estop
//
// `expire` is the end of a set-point's time to live, and a link that closed. From timeout only `stop` leads on,
// from fault and estop only `clear`, and from there only `arm` and a new set-point lead to running. An idle module
// stays idle whatever is wrong with it (its motor may well be without supply), but can't be armed then.
#pragma once

#include <stdint.h>

namespace tensionlab {
namespace firmware {

enum class State : uint8_t { idle, armed, running, timeout, fault, estop };
enum class Event : uint8_t { arm, set_point, stop, estop, clear, expire, fault };

constexpr int kStates = 6, kEvents = 7;

struct Transition {
  bool accepted;
  State next;
};

inline constexpr Transition kTransitions[kEvents][kStates] = {
    // arm
    {{true, State::armed},
     {false, State::armed},
     {false, State::running},
     {false, State::timeout},
     {false, State::fault},
     {false, State::estop}},
    // set_point
    {{false, State::idle},
     {true, State::running},
     {true, State::running},
     {false, State::timeout},
     {false, State::fault},
     {false, State::estop}},
    // stop
    {{true, State::idle},
     {true, State::idle},
     {true, State::idle},
     {true, State::idle},
     {false, State::fault},
     {false, State::estop}},
    // estop
    {{true, State::estop},
     {true, State::estop},
     {true, State::estop},
     {true, State::estop},
     {true, State::estop},
     {true, State::estop}},
    // clear
    {{true, State::idle},
     {true, State::armed},
     {true, State::running},
     {true, State::timeout},
     {true, State::idle},
     {true, State::idle}},
    // expire
    {{true, State::idle},
     {true, State::timeout},
     {true, State::timeout},
     {true, State::timeout},
     {true, State::fault},
     {true, State::estop}},
    // fault
    {{true, State::idle},
     {true, State::fault},
     {true, State::fault},
     {true, State::fault},
     {true, State::fault},
     {true, State::estop}},
};

constexpr Transition transition(State state, Event event) {
  return kTransitions[static_cast<int>(event)][static_cast<int>(state)];
}

// Whether the motor may be driven in a state.
constexpr bool is_driven(State state) {
  return state == State::armed || state == State::running || state == State::timeout;
}

}  // namespace firmware
}  // namespace tensionlab
