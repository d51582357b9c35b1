// Threads that share the rows of a batch. They sleep between batches: starting one takes as long as hundreds of
// problems.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdlib>
#include <exception>
#include <mutex>
#include <system_error>
#include <thread>

#include "bindings/bindings.hpp"
#include "tensionlab/simd/batch.hpp"

#if !defined(_WIN32)
#include <unistd.h>
#endif

namespace tensionlab {
namespace {

using Clock = std::chrono::steady_clock;
using Work = std::function<void(std::size_t, std::size_t)>;

unsigned long main_thread = 0;  // of Python

// TENSIONLAB_NUM_THREADS, or the number of processors.
unsigned thread_count() {
  if (const char* text = std::getenv("TENSIONLAB_NUM_THREADS")) {
    const long count = std::strtol(text, nullptr, 10);
    if (count > 0) return static_cast<unsigned>(std::min(count, 1024L));
  }
  return std::max(1U, std::thread::hardware_concurrency());
}

class SharedBatch;
thread_local SharedBatch* current = nullptr;  // the batch that this thread takes part in
thread_local bool checks_signals = false;

// Rows in blocks; each free thread takes the next.
class SharedBatch {
 public:
  SharedBatch(std::size_t size, std::size_t threads, const Work& work)
      : size_(size), largest_(std::max(kFairBlock, size / (kBlocksEach * threads))), work_(work) {}

  // Solves blocks until there is none, or a thread has failed. A block grows while it takes little time.
  void take_part(bool signals) noexcept {
    current = this;
    checks_signals = signals;
    try {
      std::size_t rows = kFirstBlock, begin;
      while ((begin = next_.fetch_add(rows, std::memory_order_relaxed)) < size_) {
        const Clock::time_point start = Clock::now();
        work_(begin, std::min(begin + rows, size_));
        pass_checkpoint();
        const Clock::duration taken = Clock::now() - start;
        if (taken < kBlockTime / 4) rows = std::min(4 * rows, largest_);
        if (taken > kBlockTime) rows = std::max(rows / 2, kFirstBlock);
      }
    } catch (...) {
      if (!failed_.exchange(true)) error_ = std::current_exception();
    }
    current = nullptr;
  }

  void pass_checkpoint() {
    if (failed_.load(std::memory_order_relaxed)) throw std::exception();  // the first error is kept
    if (!checks_signals || Clock::now() < next_look_) return;
    const nanobind::gil_scoped_acquire locked;
    if (PyErr_CheckSignals() != 0) throw nanobind::python_error();
    next_look_ = Clock::now() + kLookPeriod;
  }

  // Once all threads have ended.
  void rethrow() const {
    if (error_) std::rethrow_exception(error_);
  }

 private:
  static constexpr std::size_t kFirstBlock = 64, kFairBlock = 1024, kBlocksEach = 8;
  static constexpr std::chrono::milliseconds kBlockTime{20}, kLookPeriod{30};

  const std::size_t size_, largest_;
  const Work& work_;
  std::atomic<std::size_t> next_{0};
  std::atomic<bool> failed_{false};
  std::exception_ptr error_;
  Clock::time_point next_look_ = Clock::now() + kLookPeriod;
};

class ThreadPool {
 public:
  // The pool of this process, or null while another caller has it. It is never destroyed, because its threads may
  // outlive other static objects. A fork leaves its child no threads, so that the child makes its own pool.
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

  // Runs the batch on this thread and on those of the others that wake up in time; returns when all have ended.
  void run(SharedBatch& batch, unsigned others, bool signals) {
    grow(others);
    {
      const std::lock_guard<std::mutex> held(state_);
      batch_ = &batch;
      wanted_ = std::min(others, threads_);
    }
    for (unsigned k = 0; k < std::min(others, threads_); ++k) wake_.notify_one();
    batch.take_part(signals);
    std::unique_lock<std::mutex> held(state_);
    wanted_ = 0;  // a thread that wakes up now is too late
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
    } catch (const std::exception&) {
      return;  // the system has no more threads: the existing ones do it
    }
  }

  [[noreturn]] void serve() {
    std::unique_lock<std::mutex> held(state_);
    for (;;) {
      wake_.wait(held, [this] { return wanted_ > 0; });
      --wanted_;
      ++working_;
      SharedBatch* const batch = batch_;
      held.unlock();
      batch->take_part(false);
      held.lock();
      if (--working_ == 0) done_.notify_one();
    }
  }

  const int process_ = process();
  std::atomic<bool> lent_{false};
  unsigned threads_ = 0;  // used by the borrower only
  std::mutex state_;      // guards the members below
  std::condition_variable wake_, done_;
  SharedBatch* batch_ = nullptr;
  unsigned wanted_ = 0, working_ = 0;
};

}  // namespace

void checkpoint() {
  if (current != nullptr) current->pass_checkpoint();
}

void share_out(std::size_t size, const Work& work, std::size_t rows_enough) {
  // Counting the processors takes longer than a problem, so it is done only for several threads.
  const std::size_t worth = size / rows_enough;
  const std::size_t threads = worth < 2 ? 1 : std::min<std::size_t>(thread_count(), worth);
  const bool signals = PyThread_get_thread_ident() == main_thread;
  SharedBatch batch(size, threads, work);
  {
    const nanobind::gil_scoped_release unlocked;
    // While another thread of the program uses the pool, the processors are busy.
    ThreadPool* pool = threads < 2 ? nullptr : ThreadPool::lend();
    if (pool != nullptr) {
      pool->run(batch, static_cast<unsigned>(threads - 1), signals);
      pool->give_back();
    } else {
      batch.take_part(signals);
    }
  }
  batch.rethrow();
}

void find_main_thread() {
  main_thread =
      nanobind::cast<unsigned long>(nanobind::module_::import_("threading").attr("main_thread")().attr("ident"));
}

}  // namespace tensionlab
