// Rolls strikes through the generated step: closest approach to the target, extremes, divergence, trajectories.
//
// Compiled together with the C that CasADi generates for `step` (and `control` where the torque is held). Defined on
// the command line: GENERATED (file to include), NQ joints, NA arm joints, NP parameters, HELD 0 or 1, FASTEST (norm of
// all joint speeds [rad/s] above which a strike counts as diverged).
#include <cmath>
#include <cstdint>
#include <limits>

#define casadi_int long long int
#define casadi_real double
#include GENERATED

namespace {

constexpr int NX = 2 * NQ;

// Nearest point of the segment between two successive tip positions.
struct ClosestApproach {
  double squared = std::numeric_limits<double>::infinity();
  double time = 0, tip[2] = {0, 0}, velocity[2] = {0, 0};

  void segment(const double* from, const double* to, double t, double h, const double* target) {
    const double dx = to[0] - from[0], dy = to[1] - from[1];
    const double ex = target[0] - from[0], ey = target[1] - from[1];
    const double length2 = dx * dx + dy * dy;
    double s = length2 > 0 ? (ex * dx + ey * dy) / length2 : 0;
    s = s < 0 ? 0 : s > 1 ? 1 : s;
    const double gx = ex - s * dx, gy = ey - s * dy, d2 = gx * gx + gy * gy;
    if (d2 < squared) {
      squared = d2, time = t + s * h;
      for (int i = 0; i < 2; ++i) {
        tip[i] = from[i] + s * (to[i] - from[i]);
        velocity[i] = from[2 + i] + s * (to[2 + i] - from[2 + i]);
      }
    }
  }
};

bool moves_too_fast(const double* x) {  // also true of NaN
  double sum = 0;
  for (int i = NQ; i < NX; ++i) sum += x[i] * x[i];
  return !(sum < FASTEST * FASTEST);
}

void roll(const double* p, const double* x0, const double* target, double h, double h_last, int64_t steps,
          int64_t hold, double* out, double* rows) {
  double x[NX], next[NX], tip[4], before[4] = {0, 0, 0, 0}, tau[NA], held[NA], now = 0, t = 0, dt = h;
  double fastest[NA] = {0}, strongest[NA] = {0};
  const double* control_arg[] = {x, &now, p};
  double* control_res[] = {held};
  const double* arg[] = {x, &now, &dt, p, held};
  double* res[] = {next, tip, tau};
  for (int i = 0; i < NX; ++i) x[i] = x0[i];
  ClosestApproach closest;
  bool diverged = false;
  int64_t done = 0;
  for (int64_t i = 0; i <= steps; ++i) {  // one evaluation more than steps: the final state has a tip, too
    now = t;
    dt = i + 1 == steps ? h_last : h;
#if HELD
    if (i % hold == 0) control(control_arg, control_res, nullptr, nullptr, 0);
#else
    (void)hold, (void)control_arg, (void)control_res;
#endif
    step(arg, res, nullptr, nullptr, 0);
    if (i > 0)
      closest.segment(before, tip, t - (i == steps ? h_last : h), i == steps ? h_last : h, target);
    for (int j = 0; j < NA; ++j) {
      fastest[j] = std::fmax(fastest[j], std::fabs(x[NQ + j]));
      strongest[j] = std::fmax(strongest[j], std::fabs(tau[j]));
    }
    if (rows) {
      double* row = rows + i * (1 + NX + NA);
      row[0] = t;
      for (int j = 0; j < NX; ++j) row[1 + j] = x[j];
      for (int j = 0; j < NA; ++j) row[1 + NX + j] = tau[j];
    }
    done = i;
    if (i == steps) break;
    if ((diverged = moves_too_fast(next))) break;
    for (int j = 0; j < NX; ++j) x[j] = next[j];
    for (int j = 0; j < 4; ++j) before[j] = tip[j];
    t = i + 1 == steps ? t + h_last : (i + 1) * h;
  }
  *out++ = std::sqrt(closest.squared);
  *out++ = closest.time;
  *out++ = std::hypot(closest.velocity[0], closest.velocity[1]);
  *out++ = closest.tip[0];
  *out++ = closest.tip[1];
  *out++ = diverged;
  *out++ = static_cast<double>(done);
  for (int j = 0; j < NA; ++j) *out++ = fastest[j];
  for (int j = 0; j < NA; ++j) *out++ = strongest[j];
}

}  // namespace

extern "C" void whiptool_roll(int64_t count, const double* p, const double* x0, const double* target, const double* h,
                              const double* h_last, const int64_t* steps, int64_t hold, double* out, double* rows) {
  for (int64_t b = 0; b < count; ++b) {
    roll(p + b * NP, x0 + b * NX, target + b * 2, h[b], h_last[b], steps[b], hold, out + b * (7 + 2 * NA), rows);
    if (rows) rows += (steps[b] + 1) * (1 + NX + NA);
  }
}
