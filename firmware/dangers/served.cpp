// One module with one defect, served over TCP for `tensionlab module doctor`.
// Arguments: the defect's name, a seed for the hardware, and "stepped" where another program makes the time pass.
// The first line printed is the port; without arguments, the names of all defects are printed.
//
// Stepped: standard input has commands of 12 bytes, each answered on standard output by 9 bytes. Command: for how
// many us time may pass, how many bytes were sent to the module over TCP so far (both u32), and the speed in m/s
// at which a hand pulls the cable's end (f32). Time stops early once the module has said something. Answer: the us
// that passed, the bytes the module has sent so far (both u32), and 1 if the driver has ever been on, else 0 (u8).
#include <arpa/inet.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

#include "defects.hpp"
#include "fakes/tasks.hpp"

namespace {

using namespace tensionlab;
using namespace tensionlab::dangers;
using fakes::board;

constexpr double kSlack = 0.03;             // m
constexpr std::uint64_t kPatience = 50000;  // us: a host that is late must not let a set-point expire
bool driven = false;                        // the driver has been on

[[noreturn]] void fail(const char* what) {
  std::perror(what);
  std::_Exit(1);
}

// The module's end of the connection.
class Wire {
 public:
  Wire() {
    sockaddr_in address = {};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    if (bind(listening_, reinterpret_cast<sockaddr*>(&address), size) != 0 || listen(listening_, 1) != 0 ||
        getsockname(listening_, reinterpret_cast<sockaddr*>(&address), &size) != 0) {
      fail("socket");
    }
    std::printf("%d\n", ntohs(address.sin_port));
    std::fflush(stdout);
  }

  bool connected() const { return file_ >= 0; }

  // Waits for a host for so many ms, -1 for ever.
  void accept_host(int milliseconds) {
    pollfd asked = {listening_, POLLIN, 0};
    if (poll(&asked, 1, milliseconds) <= 0) return;
    file_ = accept(listening_, nullptr, nullptr);
    const int on = 1;
    setsockopt(file_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  }

  // Takes what has come, and waits until it is `expected` bytes since the beginning.
  void receive(fakes::Port& port, std::uint32_t expected) {
    pollfd asked = {file_, POLLIN, 0};
    while (connected() && (received_ < expected || poll(&asked, 1, 0) > 0)) {
      std::uint8_t bytes[4096];
      const ssize_t count = recv(file_, bytes, sizeof bytes, 0);
      if (count <= 0) {
        close(file_);
        file_ = -1;
        break;
      }
      received_ += static_cast<std::uint32_t>(count);
      port.arriving.insert(port.arriving.end(), bytes, bytes + count);
      note(bytes, static_cast<std::size_t>(count));
    }
  }

  void send(fakes::Port& port) {
    const std::size_t size = port.sent.size();
    if (connected() && ::send(file_, port.sent.data(), size, MSG_NOSIGNAL) != static_cast<ssize_t>(size)) {
      close(file_);
      file_ = -1;
    }
    sent_ += static_cast<std::uint32_t>(size);
    port.sent.clear();
  }

  std::uint32_t sent() const { return sent_; }
  // How long the host has not been heard of, where it lets the module pull; 0 elsewhere.
  std::uint64_t silence_us() const { return pulling_ && connected() ? fakes::now_us() - heard_us_ : 0; }

 private:
  void note(const std::uint8_t* bytes, std::size_t size) {
    heard_us_ = fakes::now_us();
    firmware::Frame frame;
    for (std::size_t i = 0; i < size; ++i) {
      if (!parser_.take(bytes[i], frame)) continue;
      const firmware::Type type = static_cast<firmware::Type>(frame.type);
      pulling_ = type == firmware::Type::arm || type == firmware::Type::set_tension;
    }
  }

  int listening_ = socket(AF_INET, SOCK_STREAM, 0), file_ = -1;
  std::uint32_t received_ = 0, sent_ = 0;
  std::uint64_t heard_us_ = 0;
  bool pulling_ = false;
  firmware::FrameParser parser_;
};

void pass(std::uint64_t microseconds) {
  fakes::sleep_us(microseconds);
  fakes::catch_up();
  fakes::watch();
}

fakes::Port& port_of(const Story& story) { return story.by_bluetooth ? board.air : board.usb; }

void step(Story& story, Wire& wire) {
  struct Command {
    std::uint32_t us, bytes;
    float hand;
  } command;
  static_assert(sizeof command == 12, "as it is sent");
  wire.accept_host(-1);
  while (read(0, &command, sizeof command) == static_cast<ssize_t>(sizeof command)) {
    wire.receive(port_of(story), command.bytes);
    board.hand_speed = static_cast<double>(command.hand);
    std::uint32_t passed = 0;
    while (passed < command.us && port_of(story).sent.empty()) {
      pass(1000);
      passed += 1000;
    }
    wire.send(port_of(story));
    std::uint8_t answer[9];
    const std::uint32_t numbers[] = {passed, wire.sent()};
    std::memcpy(answer, numbers, sizeof numbers);
    answer[8] = driven ? 1 : 0;
    if (write(1, answer, sizeof answer) != static_cast<ssize_t>(sizeof answer)) break;
  }
}

void serve(Story& story, Wire& wire) {
  using Clock = std::chrono::steady_clock;
  const auto begun = Clock::now();
  const std::uint64_t begun_us = fakes::now_us();
  std::uint64_t waited_us = 0;  // for a host that is late
  for (;;) {
    if (!wire.connected()) wire.accept_host(1);
    usleep(1000);
    const auto elapsed = std::chrono::duration_cast<std::chrono::microseconds>(Clock::now() - begun).count();
    const std::uint64_t due_us = begun_us + static_cast<std::uint64_t>(elapsed) - waited_us;
    while (fakes::now_us() < due_us) {
      wire.receive(port_of(story), 0);
      if (story.by_bluetooth) board.air.connected = wire.connected();
      if (wire.silence_us() > kPatience) {
        waited_us += due_us - fakes::now_us();
        break;
      }
      pass(1000);
      wire.send(port_of(story));
    }
  }
}

}  // namespace

int main(int count, char** words) {
  if (count < 3) {
    for (int number = 0; number < kDefectCount; ++number) std::puts(kDefects[number].name);
    return 0;
  }
  const Defect* const defect = std::find_if(
      kDefects, kDefects + kDefectCount, [&](const Defect& one) { return std::strcmp(one.name, words[1]) == 0; });
  if (defect == kDefects + kDefectCount) {
    std::fprintf(stderr, "there is no defect '%s'; those there are: run this without arguments\n", words[1]);
    return 2;
  }
  Story story(static_cast<std::uint64_t>(std::atoi(words[2])));
  defect->before(story);
  story.boot(0.4);
  defect->after(story);
  board.on_event = [](const char* what, double value) {
    driven = driven || (std::strcmp(what, "driver") == 0 && value == 1.0);
  };
  board.hand_speed = -kSlack / 0.1;
  pass(100000);
  board.hand_speed = 0.0;
  story.host().listen();  // what it said until now
  Wire wire;
  if (count > 3) {
    step(story, wire);
  } else {
    serve(story, wire);
  }
  std::_Exit(0);
}
