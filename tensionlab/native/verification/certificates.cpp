// Certificates of a batch of answers, by the verifier of tensionlab/verification/certificates.hpp.
#include "tensionlab/verification/certificates.hpp"

#include <cmath>
#include <cstdint>

#include "verification/kernels.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

void verify(const Batch& batch, const VerificationSettings& settings, const Selection& rows,
            const Findings& findings) {
  with_size(batch.n, [&](auto n) {
    const Verifier<double, TENSIONLAB_LANES, n, kMaxCables> verifier(batch.m, batch.weights, settings.rule,
                                                                     settings.tolerance, settings.rank_tolerance);
    const auto m = static_cast<std::size_t>(batch.m);
    bool flawed = false;
    for (std::size_t j = 0; j < rows.count; ++j) {
      const std::size_t row = rows[j];
      const auto finding = verifier.verify(batch[row], findings.tensions + row * m, findings.rendered + row * n,
                                           findings.separation + row * n);
      findings.status[row] = static_cast<std::int8_t>(finding.status);
      findings.residual[row] = finding.residual;
      findings.scale[row] = finding.scale;
      flawed = flawed || finding.status == Status::unproven || finding.status == Status::failed;
    }
    if (flawed) *findings.flawed = true;
  });
}

void check(const double* numbers, std::size_t count, double limit, bool& inside) {
  using V = Lanes<double, TENSIONLAB_LANES>;
  const V most = V{} + limit;
  auto good = most == most;
  std::size_t i = 0;
  for (; i + TENSIONLAB_LANES <= count; i += TENSIONLAB_LANES) {
    good = good & (magnitude(load<double, TENSIONLAB_LANES>(numbers + i)) < most);
  }
  inside = !any(!good);
  for (; i < count; ++i) inside = inside && std::abs(numbers[i]) < limit;
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
