// Ratings of winding and driver by the core's estimate, and that estimate held against random hardware. A line
// each: "continuous", a room in °C, and the current in A for good; "hold", the room, a current in A, and for how
// many s it is allowed from cold, after an hour at half the continuous current, and after an hour at all of it and
// a minute's rest; and "random", how many modules, by how much the winding was warmer than estimated at most (K),
// and the warmest winding, housing and driver (°C). Arguments: how many, and a factor of the housing's resistance
// to the room, 1 for hardware as it is expected.
#include <algorithm>
#include <cstdio>
#include <cstdlib>

#include "core/thermal.hpp"
#include "esp32/board.hpp"
#include "plant/heat.hpp"
#include "plant/noise.hpp"

namespace {

using namespace tensionlab;
using firmware::Parameter;
using firmware::ThermalModel;

constexpr double kStep = 0.01;  // s

firmware::Parameters in_room(float celsius) {
  firmware::Parameters parameters;
  parameters.set(Parameter::ambient, celsius);
  return parameters;
}

ThermalModel after(ThermalModel model, float current, double seconds, const firmware::Parameters& p) {
  for (double gone = 0.0; gone < seconds; gone += kStep) model.advance(current, static_cast<float>(kStep), p);
  return model;
}

// For how long a current is allowed, in s.
double hold(ThermalModel model, float current, const firmware::Parameters& p) {
  double seconds = 0.0;
  for (; model.current_limit(p) >= current && seconds < 1e4; seconds += kStep) {
    model.advance(current, static_cast<float>(kStep), p);
  }
  return seconds;
}

void rate(float room) {
  const firmware::Parameters p = in_room(room);
  ThermalModel cold(firmware::board::kDriverHeat);
  cold.assume_cold(p);
  const float continuous = cold.continuous(p);
  const ThermalModel warm = after(cold, 0.5f * continuous, 3600.0, p);
  const ThermalModel hot = after(after(cold, 0.999f * continuous, 3600.0, p), 0.0f, 60.0, p);
  std::printf("continuous %g %.4f\n", static_cast<double>(room), static_cast<double>(continuous));
  for (const float current : {4.0f / 3.0f, 5.0f / 3.0f, 2.0f}) {
    std::printf("hold %g %.4f", static_cast<double>(room), static_cast<double>(current));
    for (const ThermalModel& model : {cold, warm, hot}) std::printf(" %.2f", hold(model, current, p));
    std::printf("\n");
  }
}

// A module of its own: parts, room, errors of measurement, and half an hour of work with pauses and restarts.
class Work {
 public:
  Work(std::uint64_t seed, double factor) : random_(seed), heat_(draw(factor)) {
    estimate_.assume_hot(p_);
    scale_ = between(0.97, 1.03);
    thermistor_ = random_.uniform() < 0.3;
    thermistor_error_ = between(-2.0, 2.0);
  }

  void play() {
    for (double left = 1800.0; left > 0.0;) {
      if (random_.uniform() < 0.1) restart();
      const double asked = random_.uniform() < 0.3 ? 2.2 : between(-0.4, 2.2);  // nothing for a sixth of the time
      const double duration = random_.uniform() < 0.2 ? between(60.0, 600.0) : between(0.2, 30.0);
      for (double gone = 0.0; gone < duration; gone += kStep) step(asked);
      left -= duration;
    }
  }

  double colder = -1e9, winding = 0.0, housing = 0.0, driver = 0.0;

 private:
  double between(double lower, double upper) { return lower + (upper - lower) * random_.uniform(); }

  plant::PlantParameters draw(double factor) {
    plant::PlantParameters p = plant::standard_plant();
    p.ambient = between(10.0, 30.0);
    p.resistance *= between(0.93, 1.07);
    p.winding_to_housing *= between(0.7, 1.15);
    p.housing_to_ambient *= factor * between(0.6, 1.2);
    p.winding_capacity *= between(0.85, 1.3);
    p.housing_capacity *= between(0.85, 1.4);
    p.driver_resistance *= between(0.85, 1.15);
    p.driver_to_ambient *= between(0.6, 1.15);
    p.driver_capacity *= between(0.7, 2.0);
    return p;
  }

  // By a watchdog, which keeps what was estimated some steps before; or with the power off for a while.
  void restart() {
    const bool power = random_.uniform() < 0.5;
    std::uint8_t image[ThermalModel::kImageSize];
    estimate_.write_image(image);
    for (int late = 0; late < 4; ++late) heat_.advance(last_ * last_, true, kStep);
    const double off = power ? between(0.0, 60.0) : 3.0;
    for (double gone = 0.0; gone < off; gone += kStep) heat_.advance(0.0, false, kStep);
    estimate_ = ThermalModel(firmware::board::kDriverHeat);
    if (power || !estimate_.read_image(image)) estimate_.assume_hot(p_);
  }

  void step(double asked) {
    const double limit = static_cast<double>(estimate_.current_limit(p_));
    const double wanted = std::clamp(asked, 0.0, limit);
    last_ = wanted / scale_;  // the control holds what is measured
    heat_.advance(last_ * last_, wanted > 0.0, kStep);
    estimate_.advance(static_cast<float>(wanted), static_cast<float>(kStep), p_);
    if (thermistor_) estimate_.correct(static_cast<float>(heat_.housing + thermistor_error_));
    colder = std::max(colder, heat_.winding - static_cast<double>(estimate_.winding()));
    winding = std::max(winding, heat_.winding);
    housing = std::max(housing, heat_.housing);
    driver = std::max(driver, heat_.driver);
  }

  plant::Noise random_;
  plant::Heat heat_;
  firmware::Parameters p_;
  ThermalModel estimate_{firmware::board::kDriverHeat};
  double scale_ = 1.0, thermistor_error_ = 0.0, last_ = 0.0;
  bool thermistor_ = false;
};

}  // namespace

int main(int, char** words) {
  for (const float room : {20.0f, 30.0f, 40.0f}) rate(room);
  double colder = -1e9, winding = 0.0, housing = 0.0, driver = 0.0;
  const int count = std::atoi(words[1]);
  for (int seed = 1; seed <= count; ++seed) {
    Work work(static_cast<std::uint64_t>(seed), std::atof(words[2]));
    work.play();
    colder = std::max(colder, work.colder);
    winding = std::max(winding, work.winding);
    housing = std::max(housing, work.housing);
    driver = std::max(driver, work.driver);
  }
  std::printf("random %d %.3f %.2f %.2f %.2f\n", count, colder, winding, housing, driver);
}
