// Writes scripts for fuzz.cpp where there is no libFuzzer: random bytes, the same for the same seed.
//
//   driver CHUNKS SEED     until so many chunks of bytes have been fed to modules
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <vector>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size);
extern unsigned long long chunks, steps, driven;

int main(int count, char** words) {
  if (count != 3) {
    std::fprintf(stderr, "usage: driver CHUNKS SEED\n");
    return 2;
  }
  const unsigned long long enough = std::strtoull(words[1], nullptr, 10);
  std::mt19937_64 random(std::strtoull(words[2], nullptr, 10));
  std::vector<std::uint8_t> script;
  while (chunks < enough) {
    script.resize(1000 + random() % 20000);
    for (std::uint8_t& byte : script) byte = static_cast<std::uint8_t>(random());
    LLVMFuzzerTestOneInput(script.data(), script.size());
  }
  std::printf("%llu chunks, %llu steps, %.0f per cent of them driven: no finding\n", chunks, steps,
              100.0 * static_cast<double>(driven) / static_cast<double>(steps));
}
