// Rolls a system's paths out on equal steps, a lane each, and in forward mode their derivatives along one direction per
// lane.
//
// Compiled together with the C that CasADi generates for `advance`, `observe` and, where a torque is held, `hold`.
// Defined on the command line: GENERATED (file to include), NX states, NP parameters, NU inputs, NU_ROW inputs per
// instant, NY observed, HELD 0 or 1, FASTEST (norm of all joint speeds [rad/s] above which a path breaks off), SIMD,
// FORWARD 0 or 1.
#include <math.h>

#include <cstdint>

#if SIMD
#include <experimental/simd>
using real = std::experimental::native_simd<double>;
constexpr int LANES = real::size();
inline real select(real::mask_type m, real a, real b) {
  where(m, b) = a;
  return b;
}
inline double lane(const real& x, int l) { return x[l]; }
inline void set_lane(real& x, int l, double value) { x[l] = value; }
#else
using real = double;
constexpr int LANES = 1;
inline real select(bool m, real a, real b) { return m ? a : b; }
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

struct Paths {  // what the caller gives and gets; rows per lane unless said otherwise
  const double *p, *x0, *dp, *dx0;
  const int64_t* steps;
  const int64_t *u_row, *du_row;  // first row of each lane's inputs; du_row < 0: they do not move
  const double *u, *du;           // rows of NU_ROW, one per instant: of a lane, steps + 2
  double h;
  int64_t hold, stride;  // steps for which a torque is held; steps between samples
  const int64_t* columns;  // of the observation, to keep
  int64_t n_columns;
  const int64_t* y_row;  // first row of each lane's samples
  double *y, *dy;        // (rows, n_columns)
};

real gather(const double* base, int64_t stride, int64_t first, int64_t count, int64_t column) {
  real x = 0;
  for (int l = 0; l < LANES; ++l)  // lanes beyond the end repeat the last
    set_lane(x, l, base[(first + (l < count ? l : count - 1)) * stride + column]);
  return x;
}

void inputs(real* to, const double* from, const int64_t* row, int64_t instant, const int64_t* steps, int64_t first,
            int64_t count) {
  for (int l = 0; l < LANES; ++l) {
    const int64_t b = first + (l < count ? l : count - 1);
    const int64_t k = instant < steps[b] ? instant : steps[b];  // a lane that ended waits for the others
    for (int j = 0; j < NU; ++j) set_lane(to[j], l, row[b] < 0 ? 0.0 : from[(row[b] + k) * NU_ROW + j]);
  }
}

void roll(const Paths& io, int64_t first, int64_t count) {
  real p[NP], x[NX], next[NX], u[NU + 1], y[NY], t = 0, h = io.h;
  for (int j = 0; j < NP; ++j) p[j] = gather(io.p, NP, first, count, j);
  for (int j = 0; j < NX; ++j) x[j] = gather(io.x0, NX, first, count, j);
  for (int j = 0; j < NU; ++j) u[j] = 0;
#if FORWARD
  real dp[NP], dx[NX], dnext[NX], du[NU + 1], dy[NY];
  for (int j = 0; j < NP; ++j) dp[j] = gather(io.dp, NP, first, count, j);
  for (int j = 0; j < NX; ++j) dx[j] = gather(io.dx0, NX, first, count, j);
  for (int j = 0; j < NU; ++j) du[j] = 0;
  const real *advance_arg[] = {x, &t, &h, p, u, dx, dp, du}, *observe_arg[] = {x, p, u, dx, dp, du};
  const real* hold_arg[] = {x, &t, p, dx, dp};
  real *advance_res[] = {next, dnext}, *observe_res[] = {y, dy}, *hold_res[] = {u, du};
#else
  const real *advance_arg[] = {x, &t, &h, p, u}, *observe_arg[] = {x, p, u}, *hold_arg[] = {x, &t, p};
  real *advance_res[] = {next}, *observe_res[] = {y}, *hold_res[] = {u};
#endif
  (void)hold_arg, (void)hold_res;
  int64_t longest = 0;
  for (int64_t b = first; b < first + (count < LANES ? count : LANES); ++b)
    longest = io.steps[b] > longest ? io.steps[b] : longest;
  bool broken[LANES] = {false};
  for (int64_t i = 0; i <= longest; ++i) {
    t = static_cast<double>(i) * h;
#if HELD
    if (i % io.hold == 0) hold(hold_arg, hold_res, nullptr, nullptr, 0);
#else
    if (NU) {
      inputs(u, io.u, io.u_row, i, io.steps, first, count);
#if FORWARD
      inputs(du, io.du, io.du_row, i, io.steps, first, count);
#endif
    }
#endif
    if (i % io.stride == 0) {
      observe(observe_arg, observe_res, nullptr, nullptr, 0);
      for (int l = 0; l < LANES && l < count; ++l) {
        if (broken[l] || i > io.steps[first + l]) continue;
        const int64_t row = (io.y_row[first + l] + i / io.stride) * io.n_columns;
        for (int64_t c = 0; c < io.n_columns; ++c) {
          io.y[row + c] = lane(y[io.columns[c]], l);
#if FORWARD
          io.dy[row + c] = lane(dy[io.columns[c]], l);
#endif
        }
      }
    }
    if (i == longest) break;
    advance(advance_arg, advance_res, nullptr, nullptr, 0);
    real speed2 = 0;
    for (int j = NX / 2; j < NX; ++j) speed2 += next[j] * next[j];
    for (int l = 0; l < LANES; ++l) {  // a broken lane leaves the caller's NaN; zeros keep its arithmetic quick
      if (!broken[l] && lane(speed2, l) < double(FASTEST) * double(FASTEST)) continue;
      broken[l] = true;
      for (int j = 0; j < NX; ++j) set_lane(next[j], l, 0.0);
    }
    for (int j = 0; j < NX; ++j) x[j] = next[j];
#if FORWARD
    for (int j = 0; j < NX; ++j) dx[j] = dnext[j];
#endif
  }
}

}  // namespace

extern "C" int whiptool_lanes() { return LANES; }

extern "C" void whiptool_paths(const Paths* io, int64_t first, int64_t count) {
  for (int64_t b = first; b < first + count; b += LANES) {
    const int64_t left = first + count - b;
    roll(*io, b, left < LANES ? left : LANES);
  }
}
