// Plays each danger with as many seeds as asked, and prints what came of it, a line a row.
// Arguments: the first seed, how many, and the row (all without it). Columns, with tabs between them: what is
// wrong, what must happen, seeds with which it did, longest time in s until it was noticed (-1: nothing to
// notice), largest tension from then on in N, faults of which the module must name one, as bits, and what
// went wrong first.
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>

#include "rows.hpp"

namespace {

using namespace tensionlab::dangers;

struct Finding {
  bool right;
  double seconds, tension;
  char why[800];
};

void judge(const Row& row, Story& story, Finding& finding) {
  const Host& host = story.host();
  const char* wrong = nullptr;
  if (row.outcome == Outcome::let_go) {
    finding.seconds = story.let_go_after;
    if (story.let_go_after < 0.0) wrong = "the driver stayed on";
    if (row.faults != 0 && (host.faults & row.faults) == 0) wrong = "the module did not name the fault";
  } else if (row.outcome == Outcome::times_out) {
    finding.seconds = story.weak_after;
    if (story.let_go_after < 0.0) wrong = "the driver stayed on";
  } else if (row.outcome == Outcome::refused) {
    finding.seconds = story.let_go_after;
    if (!host.refused) wrong = "it was not refused";
  } else {
    finding.seconds = row.outcome == Outcome::reports ? story.reported_after : -1.0;
    if (story.let_go_after >= 0.0) wrong = "the driver went off";
    if (story.least_tension < row.least_n) wrong = "pulled too little";
  }
  if (row.says != nullptr && host.log.find(row.says) == std::string::npos) wrong = "it said something else";
  if (!story.accepted) wrong = "a command was refused";
  if (story.hottest > 105.0) wrong = "the winding got too warm";  // class A
  finding.tension = story.most_tension;
  if (wrong == nullptr && finding.seconds > row.within_s) wrong = "noticed too late";
  if (wrong == nullptr && finding.tension > row.most_n + 1e-9) wrong = "pulled too much";
  finding.right = wrong == nullptr;
  std::snprintf(finding.why, sizeof finding.why, "%s (%.4f s, %.2f to %.2f N, faults %d, state %d) %.30s",
                wrong == nullptr ? "" : wrong, finding.seconds, story.least_tension, finding.tension, host.faults,
                static_cast<int>(host.state), host.log.c_str());
}

}  // namespace

int main(int count, char** words) {
  const int first = std::atoi(words[1]), seeds = std::atoi(words[2]);
  void* const shared = mmap(nullptr, sizeof(Finding), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  Finding& finding = *static_cast<Finding*>(shared);
  for (int number = 0; number < kRowCount; ++number) {
    if (count > 3 && number != std::atoi(words[3])) continue;
    const Row& row = kRows[number];
    int right = 0;
    Finding worst = {true, -1.0, 0.0, ""};
    for (int seed = first; seed < first + seeds; ++seed) {
      finding = Finding{};
      std::snprintf(finding.why, sizeof finding.why, "the program ended");
      const pid_t child = fork();
      if (child == 0) {  // each starts from the very beginning
        Story story(static_cast<std::uint64_t>(seed) * 1000 + static_cast<std::uint64_t>(number));
        row.play(story);
        judge(row, story, finding);
        _exit(0);
      }
      waitpid(child, nullptr, 0);
      right += finding.right ? 1 : 0;
      worst.seconds = std::max(worst.seconds, finding.seconds);
      worst.tension = std::max(worst.tension, finding.tension);
      if (!finding.right && worst.why[0] == 0) {
        std::snprintf(worst.why, sizeof worst.why, "seed %d: %.600s", seed, finding.why);
      }
    }
    std::printf("%s\t%s\t%d\t%.6f\t%.4f\t%d\t%s\n", row.fault, row.happens, right, worst.seconds, worst.tension,
                row.faults, worst.why);
    std::fflush(stdout);
  }
}
