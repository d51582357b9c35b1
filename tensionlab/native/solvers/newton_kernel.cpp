// The exact solver over a batch of problems.
#include <algorithm>
#include <cmath>
#include <limits>

#include "solvers/kernels.hpp"
#include "tensionlab/solvers/nearest_face.hpp"
#include "tensionlab/solvers/newton.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

constexpr int kLanes = TENSIONLAB_LANES;

// Newton steps for all rows; the nearest face, a vector of problems at a time, for those proved infeasible; and
// proximal steps, at the end, for the few whose face is in doubt.
template <int N>
class NewtonBatch {
 public:
  NewtonBatch(const Batch& batch, Policy policy, double rank_tolerance, double tolerance,
              const NewtonAnswer& answer)
      : batch_(batch), policy_(policy), rank_tolerance_(rank_tolerance), tolerance_(tolerance), answer_(answer) {
    unweighted_ = policy == Policy::force;
    for (int k = 0; k < N; ++k) {
      roots_[k] = std::sqrt(batch.weights[k]);
      unweighted_ = unweighted_ && batch.weights[k] == 1;
    }
  }

  void solve(const Selection& rows, std::size_t separated = 0) {
    Face face(batch_.m);
    std::size_t begin = 0;
    if (policy_ == Policy::direction || !has(Route::nearest_face)) separated = 0;
    while (begin < separated) {
      for (const std::size_t end = std::min(begin + kChunk, separated); begin < end; ++begin) {
        enqueue(rows[begin], face);
      }
      flush(face);
    }
    if (begin == rows.count) return;
    Block block(batch_.m, roots_, policy_, rank_tolerance_, tolerance_,
                has(Route::nearest_face) && policy_ != Policy::direction);
    for (; begin < rows.count; begin += kChunk) {
      refill<kLanes>(
          block, begin, std::min(begin + kChunk, rows.count),
          [&](int l, std::size_t j) { block.load(l, batch_[rows[j]]); },
          [&](int l, std::size_t j) {
            const std::size_t row = rows[j];
            answer_.iterations[row] = block.store(l, tensions(row), separation(row));
            if (policy_ == Policy::direction && block.failed(l)) prefer_exact_force(row);
            if (block.separated(l)) enqueue(row, face);
          });
      flush(face);
    }
  }

 private:
  using Block = Newton<double, kLanes, N, kMaxCables>;
  using Face = NearestFace<double, kLanes, N, kMaxCables>;
  static constexpr std::size_t kChunk = 512;

  // A row whose wrench is separated waits until there is one for each lane.
  void enqueue(std::size_t row, Face& face) {
    waiting_[waiting_count_++] = row;
    if (waiting_count_ == kLanes) find_faces(face);
  }

  void flush(Face& face) {
    if (waiting_count_ > 0) find_faces(face);
    if (doubtful_count_ > 0) solve_doubtful();
  }

  // Nearest faces of the waiting rows; if they are fewer than the lanes, the last one is repeated.
  void find_faces(Face& face) {
    Problem<double> problem[kLanes];
    const double* direction[kLanes];
    for (int l = 0; l < kLanes; ++l) {
      const std::size_t row = waiting_[std::min(l, waiting_count_ - 1)];
      problem[l] = batch_[row];
      direction[l] = separation(row);
      if (!unweighted_) change_coordinates(coordinates_[l], problem[l], direction_[l], direction[l]);
    }
    face.solve(problem, direction);
    std::fill_n(proved_, waiting_count_, false);
    if (has(Route::proof_in_face) && unweighted_ && answer_.status != nullptr) store_proved(face);
    for (int l = 0; l < waiting_count_; ++l) {
      const std::size_t row = waiting_[l];
      if (proved_[l]) continue;
      if (!face.found(l)) {
        doubtful_[doubtful_count_++] = row;
        continue;
      }
      answer_.iterations[row] += face.store(l, tensions(row), direction_[l]);
      if (unweighted_) {
        std::copy_n(direction_[l], N, separation(row));
      } else {
        coordinates_[l].back(direction_[l], separation(row));
      }
    }
    waiting_count_ = 0;
  }

  // Writes the answers that are proved, and notes which are.
  void store_proved(const Face& face) {
    face.prove(tolerance_, proof_);
    double unused[kMaxCables > N ? kMaxCables : N], *to_tensions[kLanes], *to_rendered[kLanes], *to_error[kLanes];
    for (int l = 0; l < kLanes; ++l) {
      const std::size_t row = waiting_[std::min(l, waiting_count_ - 1)];
      proved_[l] = l < waiting_count_ && read<double>(proof_.proved, l) != 0;
      to_tensions[l] = proved_[l] ? tensions(row) : unused;
      to_rendered[l] = proved_[l] ? answer_.rendered + row * N : unused;
      to_error[l] = proved_[l] ? separation(row) : unused;
      if (!proved_[l]) continue;
      answer_.iterations[row] += face.steps(l);
      answer_.residual[row] = read<double>(proof_.residual, l);
      answer_.scale[row] = std::numeric_limits<double>::quiet_NaN();
      answer_.status[row] = 1;
    }
    store_rows<double, kLanes>(proof_.tensions, batch_.m, to_tensions);
    store_rows<double, kLanes>(proof_.rendered, N, to_rendered);
    store_rows<double, kLanes>(proof_.error, N, to_error);
  }

  // Puts the problem into the coordinates in which the policy measures errors, and the direction d with it, at y.
  void change_coordinates(Coordinates<double, N, kMaxCables>& coordinates, Problem<double>& problem, double* y,
                          const double*& d) const {
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

  // The direction policy keeps the direction only where the nearest force would not be exact. The separation shows
  // that, but for wrenches that are nearly rendered, and where the search for the scale was cut short.
  void prefer_exact_force(std::size_t row) const {
    const Problem<double> problem = batch_[row];
    const double most = tolerance_ * larger(1.0, std::sqrt(dot<N>(problem.wrench, problem.wrench)));
    const double* d = separation(row);
    if (least_error(problem, d) > most || !(error_of(problem, tensions(row)) > most)) return;
    double tensions_of_force[kMaxCables], proof[N];
    std::int64_t iterations;
    const Batch one{1,
                    N,
                    batch_.m,
                    {problem.structure, 0},
                    {problem.wrench, 0},
                    {problem.lower, 0},
                    {problem.upper, 0},
                    {problem.reference, 0},
                    batch_.weights};
    NewtonBatch(one, Policy::force, rank_tolerance_, tolerance_, {tensions_of_force, proof, &iterations})
        .solve({0, 1});
    answer_.iterations[row] += iterations;
    if (error_of(problem, tensions_of_force) <= most) std::copy_n(tensions_of_force, batch_.m, tensions(row));
  }

  // A lower bound of the error of any tensions, by the direction d.
  double least_error(const Problem<double>& problem, const double* d) const {
    double reach = 0;
    for (int i = 0; i < batch_.m; ++i) {
      double along = 0;
      for (int k = 0; k < N; ++k) along += d[k] * problem.structure[k * batch_.m + i];
      reach += along * (along > 0 ? problem.upper[i] : problem.lower[i]);
    }
    const double length = std::sqrt(dot<N>(d, d));
    return length > 0 ? (dot<N>(d, problem.wrench) - reach) / length : 0;
  }

  double error_of(const Problem<double>& problem, const double* tensions) const {
    double error[N];
    std::copy_n(problem.wrench, N, error);
    for (int k = 0; k < N; ++k) {
      for (int i = 0; i < batch_.m; ++i) error[k] -= problem.structure[k * batch_.m + i] * tensions[i];
    }
    return std::sqrt(dot<N>(error, error));
  }

  void solve_doubtful() {
    Block block(batch_.m, roots_, policy_, rank_tolerance_, tolerance_);
    refill<kLanes>(
        block, 0, doubtful_count_, [&](int l, std::size_t j) { block.load(l, batch_[doubtful_[j]]); },
        [&](int l, std::size_t j) {
          const std::size_t row = doubtful_[j];
          answer_.iterations[row] += block.store(l, tensions(row), separation(row));
        });
    doubtful_count_ = 0;
  }

  double* tensions(std::size_t row) const { return answer_.tensions + row * static_cast<std::size_t>(batch_.m); }
  double* separation(std::size_t row) const { return answer_.separation + row * N; }

  const Batch& batch_;
  Policy policy_;
  double rank_tolerance_, tolerance_;
  const NewtonAnswer& answer_;
  double roots_[N];
  bool unweighted_;  // errors are measured in the coordinates as given
  Coordinates<double, N, kMaxCables> coordinates_[kLanes];
  double direction_[kLanes][N];
  typename Face::Proof proof_;
  bool proved_[kLanes];
  std::size_t waiting_[kLanes], doubtful_[kChunk], doubtful_count_ = 0;  // rows
  int waiting_count_ = 0;
};

void newton(const Batch& batch, Policy policy, double rank_tolerance, double tolerance, const Selection& rows,
            std::size_t separated, const NewtonAnswer& answer) {
  with_size(batch.n, [&](auto n) {
    NewtonBatch<n>(batch, policy, rank_tolerance, tolerance, answer).solve(rows, separated);
  });
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
