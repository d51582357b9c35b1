// What to render where the wrench is out of reach.
#pragma once

namespace tensionlab {

enum class Policy { force, tension, direction };

constexpr int kPolicies = 3;

}  // namespace tensionlab
