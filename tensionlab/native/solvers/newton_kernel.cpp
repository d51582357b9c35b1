// The exact solver over a batch of problems; compiled once for each instruction set (simd/instruction_set.hpp).
#include <algorithm>
#include <cmath>
#include <limits>

#include "simd/lane_scheduler.hpp"
#include "solvers/nearest_face.hpp"
#include "solvers/newton.hpp"
#include "solvers/newton_batch.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

constexpr int kLanes = TENSIONLAB_LANES;

// A batch: Newton steps for all; the nearest face, many at a time, for what they prove out of reach; and proximal
// steps, at the end, for the few whose face leaves a doubt.
template <int N>
class NewtonBatch {
 public:
  NewtonBatch(const Batch& batch, Policy policy, double rank_tolerance, double tolerance,
              const NewtonAnswer& answer)
      : batch_(batch), policy_(policy), rank_tolerance_(rank_tolerance), tolerance_(tolerance), answer_(answer) {
    plain_ = policy == Policy::force;
    for (int k = 0; k < N; ++k) {
      roots_[k] = std::sqrt(batch.weights[k]);
      plain_ = plain_ && batch.weights[k] == 1;
    }
  }

  void solve(const Selection& rows, std::size_t apart = 0) {
    Face face(batch_.m);
    std::size_t begin = 0;
    if (policy_ == Policy::direction) apart = 0;
    while (begin < apart) {
      for (const std::size_t end = std::min(begin + kChunk, apart); begin < end; ++begin) {
        set_aside(rows[begin], face);
      }
      seek_the_others(face);
    }
    if (begin == rows.count) return;
    Block block(batch_.m, roots_, policy_, rank_tolerance_, tolerance_, policy_ != Policy::direction);
    for (; begin < rows.count; begin += kChunk) {
      refill<kLanes>(
          block, begin, std::min(begin + kChunk, rows.count),
          [&](int l, std::size_t j) { block.load(l, problem(rows[j])); },
          [&](int l, std::size_t j) {
            const std::size_t row = rows[j];
            answer_.iterations[row] = block.store(l, tensions(row), separation(row));
            if (policy_ == Policy::direction && block.astray(l)) give_up(row);
            if (block.aside(l)) set_aside(row, face);
          });
      seek_the_others(face);
    }
  }

 private:
  using Block = Newton<double, kLanes, N, kMaxCables>;
  using Face = NearestFace<double, kLanes, N, kMaxCables>;
  static constexpr std::size_t kChunk = 512;

  // A row whose wrench is separated waits until the lanes are full.
  void set_aside(std::size_t row, Face& face) {
    aside_[waiting_++] = row;
    if (waiting_ == kLanes) seek(face);
  }

  void seek_the_others(Face& face) {
    if (waiting_ > 0) seek(face);
    if (doubts_ > 0) make_sure();
  }

  // The nearest faces for the rows that wait; where they are fewer than the lanes, the last one many times.
  void seek(Face& face) {
    Source<double> source[kLanes];
    const double* direction[kLanes];
    for (int l = 0; l < kLanes; ++l) {
      const std::size_t row = aside_[std::min(l, waiting_ - 1)];
      source[l] = problem(row);
      direction[l] = separation(row);
      if (!plain_) measure_as_desired(coordinates_[l], source[l], direction_[l], direction[l]);
    }
    face.solve(source, direction);
    if (plain_ && answer_.status != nullptr) {
      prove(face);
    } else {
      for (int l = 0; l < waiting_; ++l) proved_[l] = false;
    }
    for (int l = 0; l < waiting_; ++l) {
      const std::size_t row = aside_[l];
      if (proved_[l]) continue;
      if (!face.found(l)) {
        doubtful_[doubts_++] = row;
        continue;
      }
      answer_.iterations[row] += face.store(l, tensions(row), direction_[l]);
      if (plain_) {
        std::copy_n(direction_[l], N, separation(row));
      } else {
        coordinates_[l].back(direction_[l], separation(row));
      }
    }
    waiting_ = 0;
  }

  // Writes the answers that are proved, and notes which are.
  void prove(const Face& face) {
    face.prove(tolerance_, proof_);
    double unused[kMaxCables > N ? kMaxCables : N], *to_tensions[kLanes], *to_rendered[kLanes], *to_error[kLanes];
    for (int l = 0; l < kLanes; ++l) {
      const std::size_t row = aside_[std::min(l, waiting_ - 1)];
      proved_[l] = l < waiting_ && read<double>(proof_.proved, l) != 0;
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

  // The problem in the coordinates of the policy; d, which separates, follows.
  void measure_as_desired(Coordinates<double, N, kMaxCables>& coordinates, Source<double>& source, double* y,
                          const double*& d) const {
    std::copy_n(d, N, y);
    d = y;
    if (policy_ == Policy::tension) {
      coordinates.whiten(batch_.m, source.structure, source.wrench, rank_tolerance_, y);
    } else {
      coordinates.weigh(batch_.m, source.structure, source.wrench, roots_, y);
    }
    source.structure = coordinates.structure;
    source.wrench = coordinates.wrench;
  }

  // A direction is given up only where the nearest force would not be exact. That is seldom needed: the separation
  // answers it but for wrenches that are nearly as good as rendered, and where the search for s has not ended.
  void give_up(std::size_t row) const {
    const Source<double> source = problem(row);
    const double most = tolerance_ * larger(1.0, std::sqrt(dot<N>(source.wrench, source.wrench)));
    const double* d = separation(row);
    if (least_error(source, d) > most || !(error_of(source, tensions(row)) > most)) return;
    double tensions_of_force[kMaxCables], proof[N];
    std::int64_t iterations;
    const auto m = static_cast<std::ptrdiff_t>(batch_.m);
    const Batch one{1,
                    N,
                    batch_.m,
                    {source.structure, N * m},
                    {source.wrench, N},
                    {source.lower, m},
                    {source.upper, m},
                    {source.reference, m},
                    batch_.weights};
    NewtonBatch(one, Policy::force, rank_tolerance_, tolerance_, {tensions_of_force, proof, &iterations})
        .solve({0, 1});
    answer_.iterations[row] += iterations;
    if (error_of(source, tensions_of_force) <= most) std::copy_n(tensions_of_force, m, tensions(row));
  }

  // What any tensions miss of the wrench at least, as d shows.
  double least_error(const Source<double>& source, const double* d) const {
    double reach = 0;
    for (int i = 0; i < batch_.m; ++i) {
      double along = 0;
      for (int k = 0; k < N; ++k) along += d[k] * source.structure[k * batch_.m + i];
      reach += along * (along > 0 ? source.upper[i] : source.lower[i]);
    }
    const double length = std::sqrt(dot<N>(d, d));
    return length > 0 ? (dot<N>(d, source.wrench) - reach) / length : 0;
  }

  double error_of(const Source<double>& source, const double* tensions) const {
    double error[N];
    std::copy_n(source.wrench, N, error);
    for (int k = 0; k < N; ++k) {
      for (int i = 0; i < batch_.m; ++i) error[k] -= source.structure[k * batch_.m + i] * tensions[i];
    }
    return std::sqrt(dot<N>(error, error));
  }

  void make_sure() {
    Block block(batch_.m, roots_, policy_, rank_tolerance_, tolerance_);
    refill<kLanes>(
        block, 0, doubts_, [&](int l, std::size_t j) { block.load(l, problem(doubtful_[j])); },
        [&](int l, std::size_t j) {
          const std::size_t row = doubtful_[j];
          answer_.iterations[row] += block.store(l, tensions(row), separation(row));
        });
    doubts_ = 0;
  }

  Source<double> problem(std::size_t row) const {
    return {batch_.structure[row], batch_.wrench[row], batch_.lower[row], batch_.upper[row],
            batch_.reference[row]};
  }
  double* tensions(std::size_t row) const { return answer_.tensions + row * static_cast<std::size_t>(batch_.m); }
  double* separation(std::size_t row) const { return answer_.separation + row * N; }

  const Batch& batch_;
  Policy policy_;
  double rank_tolerance_, tolerance_;
  const NewtonAnswer& answer_;
  double roots_[N];
  bool plain_;  // errors are measured in the coordinates as given
  Coordinates<double, N, kMaxCables> coordinates_[kLanes];
  double direction_[kLanes][N];
  typename Face::Proof proof_;
  bool proved_[kLanes];
  std::size_t aside_[kLanes], doubtful_[kChunk], doubts_ = 0;  // rows
  int waiting_ = 0;
};

template <int N>
void newton_of_size(const Batch& batch, Policy policy, double rank_tolerance, double tolerance,
                    const Selection& rows, std::size_t apart, const NewtonAnswer& answer) {
  NewtonBatch<N>(batch, policy, rank_tolerance, tolerance, answer).solve(rows, apart);
}

void newton(const Batch& batch, Policy policy, double rank_tolerance, double tolerance, const Selection& rows,
            std::size_t apart, const NewtonAnswer& answer) {
  static constexpr decltype(&newton) kSolve[] = {newton_of_size<1>, newton_of_size<2>, newton_of_size<3>,
                                                 newton_of_size<4>, newton_of_size<5>, newton_of_size<6>};
  kSolve[batch.n - 1](batch, policy, rank_tolerance, tolerance, rows, apart, answer);
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
