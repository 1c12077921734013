// Rolls strikes through the generated step, a lane each: closest approach to the target, extremes, divergence,
// trajectories, and in forward mode the derivative of all that along one direction per lane.
//
// Compiled together with the C that CasADi generates for `step` (and `control` where the torque is held). Defined on
// the command line: GENERATED (file to include), NQ joints, NA arm joints, NP parameters, HELD 0 or 1, FASTEST (norm of
// all joint speeds [rad/s] above which a strike counts as diverged), SIMD 0 or 1, FORWARD 0 or 1.
#include <math.h>

#include <cmath>
#include <cstdint>
#include <limits>

#if SIMD
#include <experimental/simd>
using real = std::experimental::native_simd<double>;
using mask = real::mask_type;
constexpr int LANES = real::size();
inline real select(mask m, real a, real b) {
  where(m, b) = a;
  return b;
}
inline double lane(const real& x, int l) { return x[l]; }
inline void set_lane(real& x, int l, double value) { x[l] = value; }
#else
using real = double;
using mask = bool;
constexpr int LANES = 1;
inline real select(mask m, real a, real b) { return m ? a : b; }
inline bool any_of(mask m) { return m; }
inline double lane(const real& x, int) { return x; }
inline void set_lane(real& x, int, double value) { x = value; }
#endif
inline real whiptool_le(real a, real b) { return select(a <= b, real(1), real(0)); }

#define casadi_int long long int
#define casadi_real real
#pragma push_macro("__STDC_VERSION__")
#define __STDC_VERSION__ 199901L  // let the generated code call fmin and fmax
#include GENERATED
#pragma pop_macro("__STDC_VERSION__")

namespace {

constexpr int NX = 2 * NQ;
constexpr int NOUT = 9 + 2 * NA;     // columns of the outcome
constexpr int NROW = 1 + NX + NA;    // columns of a trajectory's row: t, x, tau

// Nearest point of the segments between successive tip positions, each a (x, y) with its velocity behind it.
struct ClosestApproach {
  real squared = std::numeric_limits<double>::infinity();
  real time = 0, tip[4] = {0, 0, 0, 0}, slope = 0;

  // Of these lanes: the segment that begins at time t and lasts h; d.. are the tips' derivatives.
  void segment(mask lanes, const real* from, const real* to, real t, real h, const real* target, const real* dfrom,
               const real* dto) {
    const real dx = to[0] - from[0], dy = to[1] - from[1];
    const real ex = target[0] - from[0], ey = target[1] - from[1];
    const real length2 = dx * dx + dy * dy;
    real s = (ex * dx + ey * dy) / select(length2 > 0, length2, real(1));
    s = select(s > 0, select(s < 1, s, real(1)), real(0));
    const real gx = s * dx - ex, gy = s * dy - ey, d2 = gx * gx + gy * gy;
    const mask nearer = lanes && (d2 < squared);
    if (!any_of(nearer)) return;
    squared = select(nearer, d2, squared);
    time = select(nearer, t + s * h, time);
    for (int i = 0; i < 4; ++i) tip[i] = select(nearer, from[i] + s * (to[i] - from[i]), tip[i]);
#if FORWARD  // where along the segment drops out: there the distance is smallest
    const real d = sqrt(d2), ux = dfrom[0] + s * (dto[0] - dfrom[0]), uy = dfrom[1] + s * (dto[1] - dfrom[1]);
    slope = select(nearer, (gx * ux + gy * uy) / select(d > 0, d, real(1)), slope);
#else
    (void)dfrom, (void)dto;
#endif
  }
};

struct Strikes {  // what the caller gives and gets; arrays of rows, one per strike
  const double *p, *x0, *target, *h, *h_last;
  const int64_t* steps;
  int64_t hold;
  const double *dp, *dx0, *dh, *dh_last;  // forward mode: the direction of each strike
  double* out;
  double* rows;               // trajectories, or null
  const int64_t* first_row;   // where each strike's rows begin
  double* path;               // tip path at equal times, or null: (strikes, samples, 2), and derivatives behind it
  int64_t samples;
  double rate;                // [1/s]
};

real gather(const double* base, int64_t stride, int64_t first, int64_t count, int64_t column) {
  real x = 0;
  for (int l = 0; l < LANES; ++l)  // lanes beyond the end repeat the last strike
    set_lane(x, l, base[(first + (l < count ? l : count - 1)) * stride + column]);
  return x;
}

// Cubic through two tips and their velocities: the path between two steps, to the integrator's own accuracy.
double hermite(double p0, double v0, double p1, double v1, double h, double s) {
  const double r = 1 - s;
  return r * r * ((1 + 2 * s) * p0 + s * h * v0) + s * s * ((1 + 2 * r) * p1 - r * h * v1);
}

void roll(const Strikes& io, int64_t first, int64_t count) {
  real p[NP], x[NX], next[NX], tip[4], before[4] = {0, 0, 0, 0}, tau[NA], held[NA + 1], now = 0, dt, target[2];
  real fastest[NA], strongest[NA], h, h_last, steps;
  for (int j = 0; j < NP; ++j) p[j] = gather(io.p, NP, first, count, j);
  for (int j = 0; j < NX; ++j) x[j] = gather(io.x0, NX, first, count, j);
  for (int j = 0; j < 2; ++j) target[j] = gather(io.target, 2, first, count, j);
  for (int j = 0; j < NA; ++j) fastest[j] = strongest[j] = 0, held[j] = 0;
  h = gather(io.h, 1, first, count, 0), h_last = gather(io.h_last, 1, first, count, 0);
  int64_t longest = 0, done[LANES];
  for (int l = 0; l < LANES; ++l) {
    const int64_t n = io.steps[first + (l < count ? l : count - 1)];
    set_lane(steps, l, static_cast<double>(n));
    longest = n > longest ? n : longest, done[l] = 0;
  }
#if FORWARD
  real dp[NP], dx[NX], dnext[NX], dtip[4], dbefore[4] = {0, 0, 0, 0}, dheld[NA + 1], dnow = 0, ddt, dh, dh_last;
  for (int j = 0; j < NP; ++j) dp[j] = gather(io.dp, NP, first, count, j);
  for (int j = 0; j < NX; ++j) dx[j] = gather(io.dx0, NX, first, count, j);
  for (int j = 0; j < NA; ++j) dheld[j] = 0;
  dh = gather(io.dh, 1, first, count, 0), dh_last = gather(io.dh_last, 1, first, count, 0);
  const real* control_arg[] = {x, &now, p, dx, &dnow, dp};
  real* control_res[] = {held, dheld};
  const real* arg[] = {x, &now, &dt, p, held, dx, &dnow, &ddt, dp, dheld};
  real* res[] = {next, tip, tau, dnext, dtip};
  const real *dfrom = dbefore, *dto = dtip;
#else
  const real* control_arg[] = {x, &now, p};
  real* control_res[] = {held};
  const real* arg[] = {x, &now, &dt, p, held};
  real* res[] = {next, tip, tau};
  const real *dfrom = nullptr, *dto = nullptr;
#endif
  ClosestApproach closest;
  mask alive = h == h, diverged = !alive;  // lanes that still move; lanes that broke off
  for (int64_t i = 0; i <= longest; ++i) {  // one evaluation more than steps: the final state has a tip, too
    const real k = static_cast<double>(i);
    const mask last = k + 1 == steps, end = k == steps;
    dt = select(last, h_last, h);
    const real elapsed = select(end, h_last, h);  // the step that led here
    now = select(end && k > 0, (k - 1) * h + h_last, k * h);
#if FORWARD
    ddt = select(last, dh_last, dh);
    const real delapsed = select(end, dh_last, dh);
    dnow = select(end && k > 0, (k - 1) * dh + dh_last, k * dh);
#endif
#if HELD
    if (i % io.hold == 0) control(control_arg, control_res, nullptr, nullptr, 0);
#else
    (void)control_arg, (void)control_res;
#endif
    step(arg, res, nullptr, nullptr, 0);
    if (i > 0) closest.segment(alive, before, tip, now - elapsed, elapsed, target, dfrom, dto);
    for (int j = 0; j < NA; ++j) {
      fastest[j] = select(alive && abs(x[NQ + j]) > fastest[j], abs(x[NQ + j]), fastest[j]);
      strongest[j] = select(alive && abs(tau[j]) > strongest[j], abs(tau[j]), strongest[j]);
    }
    for (int l = 0; l < LANES && l < count && (io.rows || io.path); ++l) {
      if (!lane(select(alive, real(1), real(0)), l)) continue;
      const double t = lane(now, l);
      if (io.rows) {
        double* row = io.rows + (io.first_row[first + l] + i) * NROW;
        *row++ = t;
        for (int j = 0; j < NX; ++j) *row++ = lane(x[j], l);
        for (int j = 0; j < NA; ++j) *row++ = lane(tau[j], l);
      }
      if (io.path) {
        const double span = lane(elapsed, l), start = i > 0 ? t - span : t;
        int64_t sample = i > 0 ? static_cast<int64_t>(std::floor(start * io.rate + 1e-9)) + 1 : 0;
        for (; sample < io.samples && sample <= t * io.rate + 1e-9; ++sample) {
          const double s = i > 0 ? (sample / io.rate - start) / span : 0;
          double* point = io.path + ((first + l) * io.samples + sample) * (FORWARD ? 4 : 2);
          for (int c = 0; c < 2; ++c) {
            const double p0 = lane(i > 0 ? before[c] : tip[c], l), v0 = lane(i > 0 ? before[2 + c] : tip[2 + c], l);
            point[c] = hermite(p0, v0, lane(tip[c], l), lane(tip[2 + c], l), span, s);
#if FORWARD  // at a fixed time: the step that holds it moves with the strike's duration
            const double dstart = i > 0 ? lane(dnow - delapsed, l) : lane(dnow, l), dspan = lane(delapsed, l);
            const double ds = i > 0 ? -(dstart + s * dspan) / span : 0, r = 1 - s;
            const double p1 = lane(tip[c], l), v1 = lane(tip[2 + c], l);
            const double q0 = lane(i > 0 ? dbefore[c] : dtip[c], l), w0 = lane(i > 0 ? dbefore[2 + c] : dtip[2 + c], l);
            point[2 + c] = hermite(q0, w0, lane(dtip[c], l), lane(dtip[2 + c], l), span, s) +
                           ds * (6 * r * s * (p1 - p0) + span * (r * (r - 2 * s) * v0 - s * (2 * r - s) * v1)) +
                           dspan * r * s * (r * v0 - s * v1);
#endif
          }
        }
      }
    }
    for (int l = 0; l < LANES; ++l)
      if (lane(select(alive, real(1), real(0)), l)) done[l] = i;
    alive = alive && !end;
    if (!any_of(alive)) break;
    real speed2 = 0;
    for (int j = NQ; j < NX; ++j) speed2 += next[j] * next[j];
    const mask wild = alive && !(speed2 < FASTEST * FASTEST);  // also true of NaN
    diverged = diverged || wild;
    alive = alive && !wild;
    for (int j = 0; j < NX; ++j) x[j] = select(alive, next[j], x[j]);  // what ended or diverged stands still
    for (int j = 0; j < 4; ++j) before[j] = select(alive, tip[j], before[j]);
#if FORWARD
    for (int j = 0; j < NX; ++j) dx[j] = select(alive, dnext[j], dx[j]);
    for (int j = 0; j < 4; ++j) dbefore[j] = select(alive, dtip[j], dbefore[j]);
#endif
  }
  for (int l = 0; l < LANES && l < count; ++l) {
    double* out = io.out + (first + l) * NOUT;
    *out++ = std::sqrt(lane(closest.squared, l));
    *out++ = lane(closest.time, l);
    *out++ = lane(closest.tip[2], l);
    *out++ = lane(closest.tip[3], l);
    *out++ = lane(closest.tip[0], l);
    *out++ = lane(closest.tip[1], l);
    *out++ = lane(select(diverged, real(1), real(0)), l);
    *out++ = static_cast<double>(done[l]);
    *out++ = lane(closest.slope, l);
    for (int j = 0; j < NA; ++j) *out++ = lane(fastest[j], l);
    for (int j = 0; j < NA; ++j) *out++ = lane(strongest[j], l);
  }
}

}  // namespace

extern "C" int whiptool_lanes() { return LANES; }

extern "C" void whiptool_roll(const Strikes* io, int64_t first, int64_t count) {
  for (int64_t b = first; b < first + count; b += LANES) {
    const int64_t left = first + count - b;
    roll(*io, b, left < LANES ? left : LANES);
  }
}
