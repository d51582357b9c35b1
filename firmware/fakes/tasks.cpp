#include "tasks.hpp"

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <thread>
#include <utility>

namespace tensionlab {
namespace fakes {

namespace {

struct Task {
  std::uint64_t wakes_us = 0;
  std::condition_variable turn;
};

std::mutex turns;
std::deque<Task> tasks(1);  // the first is that of main()
std::size_t running = 0;
thread_local std::size_t self = 0;

void wait_for_turn(std::unique_lock<std::mutex> lock) {
  tasks[self].turn.wait(lock, [] { return running == self; });
}

}  // namespace

std::uint64_t now_us() { return tasks[running].wakes_us; }

void sleep_us(std::uint64_t duration) {
  std::unique_lock<std::mutex> lock(turns);
  tasks[self].wakes_us += duration;
  const auto first = std::min_element(tasks.begin(), tasks.end(), [](const Task& one, const Task& other) {
    return one.wakes_us < other.wakes_us;
  });
  running = static_cast<std::size_t>(first - tasks.begin());
  if (running == self) return;
  first->turn.notify_one();
  wait_for_turn(std::move(lock));
}

void start_task(const std::function<void()>& task) {
  const std::lock_guard<std::mutex> lock(turns);
  const std::size_t number = tasks.size();
  tasks.emplace_back();
  tasks.back().wakes_us = now_us();
  std::thread([=] {
    self = number;
    wait_for_turn(std::unique_lock<std::mutex>(turns));
    task();
  }).detach();
}

}  // namespace fakes
}  // namespace tensionlab
