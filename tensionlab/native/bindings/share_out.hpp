// Threads that share out the rows of a batch. They wait for work and sleep meanwhile: to make one costs as much as
// hundreds of problems do.
#pragma once

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <cstddef>
#include <cstdlib>
#include <mutex>
#include <system_error>
#include <thread>

#if !defined(_WIN32)
#include <unistd.h>
#endif

namespace tensionlab {

// TENSIONLAB_NUM_THREADS, or as many as the machine has.
inline unsigned thread_count() {
  if (const char* text = std::getenv("TENSIONLAB_NUM_THREADS")) {
    const long count = std::strtol(text, nullptr, 10);
    if (count > 0) return static_cast<unsigned>(std::min(count, 1024L));
  }
  return std::max(1U, std::thread::hardware_concurrency());
}

// Rows in blocks, taken one after another by whoever is free.
class Blocks {
 public:
  Blocks(std::size_t size, std::size_t block) : size_(size), block_(block) {}

  bool take(std::size_t& begin, std::size_t& end) {
    begin = next_.fetch_add(block_, std::memory_order_relaxed);
    end = std::min(begin + block_, size_);
    return begin < size_;
  }

 private:
  const std::size_t size_, block_;
  std::atomic<std::size_t> next_{0};
};

class ThreadPool {
 public:
  // The pool of this process, or null while another caller has it. It is never destroyed, because its threads may
  // outlive whatever else is static; and a fork leaves its child none of them, so that a child makes a pool of its
  // own.
  static ThreadPool* lend() {
    static std::atomic<ThreadPool*> own{nullptr};
    ThreadPool* pool = own.load();
    if (pool == nullptr || pool->process_ != process()) {
      auto* fresh = new ThreadPool;
      if (own.compare_exchange_strong(pool, fresh)) {
        pool = fresh;
      } else {
        delete fresh;
      }
    }
    return pool->lent_.exchange(true) ? nullptr : pool;
  }

  void give_back() { lent_ = false; }

  // job() on this thread and on as many others as are awake in time; ends when all of them have ended.
  template <class Job>
  void run(unsigned others, const Job& job) {
    grow(others);
    {
      const std::lock_guard<std::mutex> held(state_);
      job_ = &job;
      call_ = [](const void* it) { (*static_cast<const Job*>(it))(); };
      wanted_ = std::min(others, threads_);
    }
    for (unsigned k = 0; k < std::min(others, threads_); ++k) wake_.notify_one();
    job();
    std::unique_lock<std::mutex> held(state_);
    wanted_ = 0;  // who wakes up now has come too late
    done_.wait(held, [this] { return working_ == 0; });
  }

 private:
#if defined(_WIN32)
  static int process() { return 0; }
#else
  static int process() { return static_cast<int>(getpid()); }
#endif

  void grow(unsigned wanted) {
    try {
      for (; threads_ < wanted; ++threads_) std::thread([this] { serve(); }).detach();
    } catch (const std::system_error&) {
      return;  // the system has no more of them: those that there are do it
    }
  }

  [[noreturn]] void serve() {
    std::unique_lock<std::mutex> held(state_);
    for (;;) {
      wake_.wait(held, [this] { return wanted_ > 0; });
      --wanted_;
      ++working_;
      held.unlock();
      call_(job_);
      held.lock();
      if (--working_ == 0) done_.notify_one();
    }
  }

  const int process_ = process();
  std::atomic<bool> lent_{false};
  unsigned threads_ = 0;  // the borrower's alone
  std::mutex state_;      // of what follows
  std::condition_variable wake_, done_;
  const void* job_ = nullptr;
  void (*call_)(const void*) = nullptr;
  unsigned wanted_ = 0, working_ = 0;
};

// work(begin, end) over [0, size), on threads when each has enough rows to pay for being woken, which takes some
// 0.1 ms. Where another thread of the program has the pool, its own is busy enough.
template <class Work>
void share_out(std::size_t size, const Work& work, std::size_t rows_enough = 1024) {
  constexpr std::size_t kLeastBlock = 1024, kBlocksEach = 8;
  // Counting the processors costs more than a problem does, so ask only when it matters.
  const std::size_t worth = size / rows_enough;
  const std::size_t threads = worth < 2 ? 1 : std::min<std::size_t>(thread_count(), worth);
  ThreadPool* pool = threads < 2 ? nullptr : ThreadPool::lend();
  if (pool == nullptr) {
    work(std::size_t{0}, size);
    return;
  }
  const std::size_t share = size / (kBlocksEach * threads);
  Blocks blocks(size, std::max(kLeastBlock, share - share % kLeastBlock));
  pool->run(static_cast<unsigned>(threads - 1), [&] {
    for (std::size_t begin, end; blocks.take(begin, end);) work(begin, end);
  });
  pool->give_back();
}

}  // namespace tensionlab
