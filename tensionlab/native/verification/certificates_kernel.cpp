// Certificates of a batch of answers; compiled once for each instruction set (simd/instruction_set.hpp).
#include "verification/certificates.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <int N>
void verify_of_size(const Batch& batch, const VerificationSettings& settings, const Selection& rows,
                    const Findings& findings) {
  const Verifier<TENSIONLAB_LANES, N, kMaxCables> verifier(batch.m, batch.weights, settings.rule,
                                                           settings.tolerance, settings.rank_tolerance);
  const auto n = static_cast<std::size_t>(N), m = static_cast<std::size_t>(batch.m);
  bool flawed = false;
  for (std::size_t j = 0; j < rows.count; ++j) {
    const std::size_t row = rows[j];
    const auto finding =
        verifier.verify({batch.structure[row], batch.wrench[row], batch.lower[row], batch.upper[row]},
                        findings.tensions + row * m, findings.rendered + row * n, findings.separation + row * n);
    findings.status[row] = static_cast<std::int8_t>(finding.status);
    findings.residual[row] = finding.residual;
    findings.scale[row] = finding.scale;
    flawed = flawed || finding.status == Verdict::iteration_limit || finding.status == Verdict::failed;
  }
  if (flawed) *findings.flawed = true;
}

void verify(const Batch& batch, const VerificationSettings& settings, const Selection& rows,
            const Findings& findings) {
  static constexpr decltype(&verify) kVerify[] = {verify_of_size<1>, verify_of_size<2>, verify_of_size<3>,
                                                  verify_of_size<4>, verify_of_size<5>, verify_of_size<6>};
  kVerify[batch.n - 1](batch, settings, rows, findings);
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
