// Tensions that depend on the pose, and render what is required over a cell.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

#include "tensionlab/simd/linear.hpp"
#include "workspace/box_share.hpp"
#include "workspace/cell_columns.hpp"
#include "workspace/facet_rays.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// Let t(y) be tensions, quadratic in the pose y, and r(y) what they lack of a wrench. With a right inverse P of
// the columns W(0) of the middle, W(y) P = I + E(y); where |E| < 1, t(y) + P (I + E)^-1 r(y) renders the wrench,
// and differs from t by at most |row of P| |r| / (1 - |E|). That needs no facets, which may turn far; but one
// policy has to do for a ball of wrenches, with its radius added to |r|.
//
// t(0) keeps the largest distance s from all limits. By duality s is the least, over the rays v of
// workspace/facet_rays.hpp, of what the limits leave along v over the sum of |v . w|: the cables that v is not
// across are at their limits less s, and balance gives the others. t(y) cancels r to second order, by P.
template <int N, int D>
class TensionPolicy {
 public:
  using Columns = CellColumns<N, D>;

  // Only cables with a bit in `loose` change their tension.
  TensionPolicy(const CertifiedRig& rig, const Columns& columns, const FacetRays<N>& rays, std::uint32_t loose,
                double rounding)
      : rig_(rig), columns_(columns), rays_(rays), loose_(loose), rounding_(rounding) {
    double rows[kMaxCables][kMaxCables] = {}, dual[kMaxCables][kMaxCables];
    for (int k = 0; k < N; ++k) {
      double axis[N] = {};
      axis[k] = 1;
      columns.pull(axis, along_[k]);
      for (int j = 0; j < columns.m; ++j) rows[k][j] = loose >> j & 1 ? columns.column[k][j] : 0;
    }
    if (!dual_basis<kMaxCables>(rows, N, 1e-5, dual)) return;
    double off = kMargin;
    for (int j = 0; j < columns.m; ++j) {
      for (int k = 0; k < N; ++k) inverse_[j][k] = loose >> j & 1 ? dual[k][j] : 0;
      row_[j] = std::sqrt(dot<N>(inverse_[j], inverse_[j])) * (1 + kMargin);
      off += row_[j] * columns.affine_rest(j);
    }
    off += size_of_product([&](int a, int j) { return columns.column[a][j]; }, 1);
    off += columns.reach(
        [&](int i) { return size_of_product([&](int a, int j) { return along_[a].slope[i][j]; }, 0); });
    certain_ = 1 - off;
  }

  // A lower bound of the share of the cell where the tensions stay within their limits.
  double share() {
    if (!(certain_ > 0)) return 0;
    CoveredShare<D> missing(columns_.cell);
    for (int k = 0; k < rig_.wrenches; ++k) {
      const double* const wrench = rig_.required + k * N;
      double middle[kMaxCables];
      if (!balance(wrench, middle)) return 0;
      extend(middle, wrench);
      for (int j = 0; j < rig_.m; ++j) {
        if (!(loose_ >> j & 1)) continue;
        for (const double side : {1.0, -1.0}) {
          CellBound<N, D> bound(columns_);
          bound.add(side, tensions_, j);
          bound.value += (side > 0 ? -rig_.lower[j] : rig_.upper[j]) - tensions_.error[j];
          bound.settle();
          if (!(bound.value > bound.reach())) missing.add(bound.value, bound.slope);
        }
      }
    }
    return 1 - missing.share();
  }

 private:
  static constexpr double kMargin = 0x1p-20, kRounding = 0x1p-40;

  const CertifiedRig& rig_;
  const Columns& columns_;
  const FacetRays<N>& rays_;
  std::uint32_t loose_;
  double rounding_;
  typename Columns::Pull along_[N];  // of each component of a wrench
  double inverse_[kMaxCables][N], row_[kMaxCables], certain_ = 0;
  typename Columns::Pull tensions_;  // in place of what a cable pulls

  // The Frobenius norm of a matrix times P, less the identity or not.
  template <class Entry>
  double size_of_product(const Entry& entry, double identity) const {
    double square = 0;
    for (int a = 0; a < N; ++a) {
      for (int k = 0; k < N; ++k) {
        double sum = a == k ? -identity : 0;
        for (int j = 0; j < rig_.m; ++j) sum += entry(a, j) * inverse_[j][k];
        square += sum * sum;
      }
    }
    return std::sqrt(square);
  }

  double weigh(const double* tensions, const double* along) const {
    double sum = 0;
    for (int j = 0; j < rig_.m; ++j) sum += tensions[j] * along[j];
    return sum;
  }

  // Finds the tensions in the middle.
  bool balance(const double* wrench, double* tensions) const {
    double least = std::numeric_limits<double>::infinity(), critical[N] = {};
    std::uint32_t spanning = 0;
    for (const FacetRay<N>& ray : rays_.all()) {
      for (const double side : {1.0, -1.0}) {
        double room = -side * dot<N>(ray.v, wrench), spread = 0;
        for (int j = 0; j < rig_.m; ++j) {
          const double along = side * columns_.pulled(ray.v, j);
          room += along * (along > 0 ? rig_.upper : rig_.lower)[j];
          spread += loose_ >> j & 1 ? std::abs(along) : 0;
        }
        if (!(room < least * spread && ray.error < 1e-6)) continue;
        least = room / spread;
        spanning = ray.spanning;
        for (int k = 0; k < N; ++k) critical[k] = side * ray.v[k];
      }
    }
    if (!(least < std::numeric_limits<double>::infinity())) return false;
    double left[N], column[N][N], basis[N][N];
    int count = 0, own[N];
    std::copy(wrench, wrench + N, left);
    for (int j = 0; j < rig_.m; ++j) {
      if (spanning >> j & 1) {
        for (int k = 0; k < N; ++k) column[count][k] = columns_.column[k][j];
        own[count++] = j;
        continue;
      }
      const bool pulls = columns_.pulled(critical, j) > 0;
      tensions[j] = (pulls ? rig_.upper : rig_.lower)[j] - (loose_ >> j & 1 ? (pulls ? least : -least) : 0);
      for (int k = 0; k < N; ++k) left[k] -= tensions[j] * columns_.column[k][j];
    }
    if (!dual_basis<N>(column, count, 1e-5, basis)) return false;
    for (int a = 0; a < count; ++a) tensions[own[a]] = dot<N>(basis[a], left);
    return true;
  }

  // Extends the tensions in the middle over the cell.
  void extend(const double* middle, const double* wrench) {
    double load[N], left[Columns::kPairs], missing = rounding_ + rig_.radius + rig_.slack;
    for (int k = 0; k < N; ++k) load[k] = weigh(middle, columns_.column[k]) - wrench[k];
    missing += respond(load, [&](int j, double change) { tensions_.value[j] = middle[j] + change; });
    for (int i = 0; i < columns_.moves; ++i) {
      for (int k = 0; k < N; ++k) load[k] = weigh(tensions_.value, along_[k].slope[i]);
      left[i] = respond(load, [&](int j, double change) { tensions_.slope[i][j] = change; });
    }
    missing += columns_.reach([&](int i) { return left[i]; });
    for (int i = 0, pair = 0; i < columns_.moves; ++i) {
      for (int l = 0; l <= i; ++l, ++pair) {
        for (int k = 0; k < N; ++k) {
          load[k] = weigh(tensions_.value, along_[k].curve[pair]) + weigh(tensions_.slope[i], along_[k].slope[l]) +
                    weigh(tensions_.slope[l], along_[k].slope[i]);
        }
        left[pair] = respond(load, [&](int j, double change) { tensions_.curve[pair][j] = change; });
      }
    }
    missing += columns_.bow([&](int pair) { return left[pair]; });
    for (int j = 0; j < rig_.m; ++j) {
      const double value = std::abs(tensions_.value[j]);
      const double reach = columns_.reach([&](int i) { return tensions_.slope[i][j]; });
      const double bow = columns_.bow([&](int pair) { return std::abs(tensions_.curve[pair][j]); });
      missing += value * columns_.quadratic_rest(j) + reach * columns_.affine_rest(j) + bow * columns_.shift(j);
      tensions_.error[j] = kRounding * (value + reach + bow);
      missing += tensions_.error[j] * columns_.largest[j];
    }
    for (int j = 0; j < rig_.m; ++j) tensions_.error[j] += row_[j] * missing / certain_;
  }

  // Passes on the changes of tensions that cancel a load in the middle; returns the size of what is left of it.
  template <class Change>
  double respond(const double* load, const Change& change) const {
    double left[N];
    std::copy(load, load + N, left);
    for (int j = 0; j < rig_.m; ++j) {
      const double tension = -dot<N>(inverse_[j], load);
      change(j, tension);
      for (int k = 0; k < N; ++k) left[k] += tension * columns_.column[k][j];
    }
    return std::sqrt(dot<N>(left, left));
  }
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
