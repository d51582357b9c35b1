// The exact solver over a batch of problems.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "tensionlab/solvers/nearest_face.hpp"
#include "tensionlab/solvers/newton.hpp"

namespace tensionlab {

inline namespace TENSIONLAB_BUILD {

// The nearest face, a vector of problems at a time, for rows that come with a direction; Newton steps for the
// others and for those without such a face; the nearest face again for those that these prove infeasible; and
// proximal steps, at the end, for the few whose face is in doubt. Chunk: the rows between such ends.
template <class Real, int L, int N, int M, int Chunk>
class NewtonBatch {
 public:
  // Answers of a row take at most 2 iteration_limit steps, and those of the nearest face, 4 N + 4.
  NewtonBatch(const BatchOf<Real>& batch, Policy policy, Real rank_tolerance, Real tolerance,
              const NewtonAnswerOf<Real>& answer, int iteration_limit = Newton<Real, L, N, M>::kIterationLimit)
      : batch_(batch),
        policy_(policy),
        rank_tolerance_(rank_tolerance),
        tolerance_(tolerance),
        answer_(answer),
        iteration_limit_(iteration_limit),
        unweighted_(policy == Policy::force) {
    for (int k = 0; k < N; ++k) {
      roots_[k] = std::sqrt(batch.weights[k]);
      unweighted_ = unweighted_ && batch.weights[k] == 1;
    }
  }

  // For the first `directed` rows the answer's separation has a direction that may separate the wrench.
  void solve(const Selection& rows, std::size_t directed = 0) {
    const bool faces = has(Route::nearest_face) && policy_ != Policy::direction;
    std::size_t begin = 0;
    if (!faces) directed = 0;
    while (begin < directed) {
      for (const std::size_t end = std::min(begin + kChunk, directed); begin < end; ++begin) enqueue(rows[begin]);
      if (waiting_count_ > 0) find_faces();
      std::size_t others[kChunk];
      const std::size_t count = std::exchange(doubtful_count_, 0);
      std::copy_n(doubtful_, count, others);
      if (count > 0) solve_by_steps({0, count, others}, 0, count, faces);
    }
    for (; begin < rows.count; begin += kChunk) {
      solve_by_steps(rows, begin, std::min(begin + kChunk, rows.count), faces);
    }
  }

 private:
  using Block = Newton<Real, L, N, M>;
  using Face = NearestFace<Real, L, N, M>;
  static constexpr std::size_t kChunk = Chunk;

  // Made where they are first needed, as most batches need one of them or none.
  Block& newton() {
    if (!block_) block_.emplace(batch_.m, roots_, policy_, rank_tolerance_, tolerance_, iteration_limit_);
    return *block_;
  }

  // Newton steps for rows [begin, end) of a selection.
  void solve_by_steps(const Selection& rows, std::size_t begin, std::size_t end, bool faces) {
    Block& block = newton();
    block.treat_infeasible(policy_, faces);
    refill<L>(
        block, begin, end, [&](int l, std::size_t j) { block.load(l, batch_[rows[j]]); },
        [&](int l, std::size_t j) {
          const std::size_t row = rows[j];
          answer_.iterations[row] = block.store(l, tensions(row), separation(row));
          if (block.separated(l)) enqueue(row);
          if (policy_ == Policy::direction && block.failed(l) && may_be_exact(row)) {
            doubtful_[doubtful_count_++] = row;
          }
        });
    if (waiting_count_ > 0) find_faces();
    if (doubtful_count_ > 0) solve_doubtful();
  }

  // A row that has a direction waits until there is one for each lane.
  void enqueue(std::size_t row) {
    waiting_[waiting_count_++] = row;
    if (waiting_count_ == L) find_faces();
  }

  // Nearest faces of the waiting rows; if they are fewer than the lanes, the last one is repeated.
  void find_faces() {
    if (!face_) face_.emplace(batch_.m);
    Problem<Real> problem[L];
    const Real* direction[L];
    for (int l = 0; l < L; ++l) {
      const std::size_t row = waiting_[std::min(l, waiting_count_ - 1)];
      problem[l] = batch_[row];
      direction[l] = separation(row);
      if (!unweighted_) change_coordinates(coordinates_[l], problem[l], direction_[l], direction[l]);
    }
    face_->solve(problem, direction);
    std::fill_n(proved_, waiting_count_, false);
    if (has(Route::proof_in_face) && unweighted_ && answer_.status != nullptr) store_proved();
    for (int l = 0; l < waiting_count_; ++l) {
      const std::size_t row = waiting_[l];
      if (proved_[l]) continue;
      if (!face_->found(l)) {
        doubtful_[doubtful_count_++] = row;
        continue;
      }
      answer_.iterations[row] += face_->store(l, tensions(row), direction_[l]);
      if (unweighted_) {
        std::copy_n(direction_[l], N, separation(row));
      } else {
        coordinates_[l].back(direction_[l], separation(row));
      }
    }
    waiting_count_ = 0;
  }

  // Writes the answers that are proved, and notes which are.
  void store_proved() {
    typename Face::Proof proof;
    face_->prove(tolerance_, proof);
    Real unused[M > N ? M : N], *to_tensions[L], *to_rendered[L], *to_error[L];
    for (int l = 0; l < L; ++l) {
      const std::size_t row = waiting_[std::min(l, waiting_count_ - 1)];
      proved_[l] = l < waiting_count_ && read<Real>(proof.proved, l) != 0;
      to_tensions[l] = proved_[l] ? tensions(row) : unused;
      to_rendered[l] = proved_[l] ? answer_.rendered + row * N : unused;
      to_error[l] = proved_[l] ? separation(row) : unused;
      if (!proved_[l]) continue;
      answer_.iterations[row] += face_->steps(l);
      answer_.residual[row] = read<Real>(proof.residual, l);
      answer_.scale[row] = std::numeric_limits<Real>::quiet_NaN();
      answer_.status[row] = 1;
    }
    store_rows<Real, L>(proof.tensions, batch_.m, to_tensions);
    store_rows<Real, L>(proof.rendered, N, to_rendered);
    store_rows<Real, L>(proof.error, N, to_error);
  }

  // Puts the problem into the coordinates in which the policy measures errors, and the direction d with it, at y.
  void change_coordinates(Coordinates<Real, N, M>& coordinates, Problem<Real>& problem, Real* y,
                          const Real*& d) const {
    std::copy_n(d, N, y);
    d = y;
    if (policy_ == Policy::tension) {
      coordinates.whiten(batch_.m, problem.structure, problem.wrench, rank_tolerance_, y);
    } else {
      coordinates.weigh(batch_.m, problem.structure, problem.wrench, roots_, y);
    }
    problem.structure = coordinates.structure;
    problem.wrench = coordinates.wrench;
  }

  // Proximal steps for the rows whose nearest face is in doubt. The direction policy keeps the direction only
  // where the nearest force would not be exact: its doubtful rows are those that may be.
  void solve_doubtful() {
    const bool as_force = policy_ == Policy::direction;
    Block& block = newton();
    block.treat_infeasible(as_force ? Policy::force : policy_, false);
    refill<L>(
        block, 0, doubtful_count_, [&](int l, std::size_t j) { block.load(l, batch_[doubtful_[j]]); },
        [&](int l, std::size_t j) {
          const std::size_t row = doubtful_[j];
          Real found[M], proof[N];
          answer_.iterations[row] += block.store(l, found, as_force ? proof : separation(row));
          const Problem<Real> problem = batch_[row];
          if (as_force && !(error_of(problem, found) <= exact_error(problem))) return;
          std::copy_n(found, batch_.m, tensions(row));
        });
    doubtful_count_ = 0;
  }

  Real exact_error(const Problem<Real>& problem) const {
    return tolerance_ * larger(Real(1), std::sqrt(dot<N>(problem.wrench, problem.wrench)));
  }

  // Whether tensions that are not exact might be: the separation leaves room for them where the wrench is nearly
  // rendered, and where the search for the scale was cut short.
  bool may_be_exact(std::size_t row) const {
    const Problem<Real> problem = batch_[row];
    const Real most = exact_error(problem);
    return !(least_error(problem, separation(row)) > most) && error_of(problem, tensions(row)) > most;
  }

  // A lower bound of the error of any tensions, by the direction d.
  Real least_error(const Problem<Real>& problem, const Real* d) const {
    Real reach = 0;
    for (int i = 0; i < batch_.m; ++i) {
      Real along = 0;
      for (int k = 0; k < N; ++k) along += d[k] * problem.structure[k * batch_.m + i];
      reach += along * (along > 0 ? problem.upper[i] : problem.lower[i]);
    }
    const Real length = std::sqrt(dot<N>(d, d));
    return length > 0 ? (dot<N>(d, problem.wrench) - reach) / length : 0;
  }

  Real error_of(const Problem<Real>& problem, const Real* tensions) const {
    Real error[N];
    std::copy_n(problem.wrench, N, error);
    for (int k = 0; k < N; ++k) {
      for (int i = 0; i < batch_.m; ++i) error[k] -= problem.structure[k * batch_.m + i] * tensions[i];
    }
    return std::sqrt(dot<N>(error, error));
  }

  Real* tensions(std::size_t row) const { return answer_.tensions + row * static_cast<std::size_t>(batch_.m); }
  Real* separation(std::size_t row) const { return answer_.separation + row * N; }

  const BatchOf<Real>& batch_;
  Policy policy_;
  Real rank_tolerance_, tolerance_;
  const NewtonAnswerOf<Real>& answer_;
  int iteration_limit_;
  Real roots_[N];
  bool unweighted_;  // errors are measured in the coordinates as given
  std::optional<Block> block_;
  std::optional<Face> face_;
  Coordinates<Real, N, M> coordinates_[L];
  Real direction_[L][N];
  bool proved_[L];
  std::size_t waiting_[L], doubtful_[kChunk], doubtful_count_ = 0;  // rows
  int waiting_count_ = 0;
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
