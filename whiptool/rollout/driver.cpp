// Rolls strikes, or chains on a moving base, through the generated functions of one link, a lane each: closest approach
// to the target, extremes, divergence, trajectories, samples of all links, and in forward mode the derivative of all
// that along one direction per lane.
//
// Compiled behind lanes.h and trigonometry.h, together with GENERATED (defined on the command line): sizes and columns as
// constants, then the C that CasADi generates for `System.functions`. Also on the command line: SIMD, FORWARD, HELD,
// PRESCRIBED, EXPLICIT, each 0 or 1, and FASTEST, the norm of all joint speeds [rad/s] above which a lane counts as
// diverged.
#include <cmath>
#include <cstdint>
#include <limits>

inline real whiptool_le(real a, real b) { return select(a <= b, real(1), real(0)); }

#define casadi_int long long int
#define casadi_real real
#define CASADI_SYMBOL_EXPORT static inline
#pragma push_macro("__STDC_VERSION__")
#define __STDC_VERSION__ 199901L  // let the generated code call fmin and fmax
#include GENERATED
#pragma pop_macro("__STDC_VERSION__")

namespace {

constexpr int NQ = N_DRIVE + LINK_SIZE * N_LINKS, NX = 2 * NQ;
constexpr int TIP = 2 * DIMENSION;                            // a place, and its velocity behind it
constexpr double FIRST = 1e-3, LONGEST = 0.02, SHORTEST = 1e-6;  // steps that lanes choose [s]
constexpr double SPAN = 0.02;                                 // for which a speed's error counts as a place's [s]
constexpr int64_t MOST_STEPS = 1000000;

// Numbers of all lanes, and how they change along the lane's direction.
template <int N>
struct Numbers {
  real x[N + !N];
#if FORWARD
  real d[N + !N];
#endif
};

// What a generated function reads and writes: a column, and its change.
struct In {
  const real* x;
#if FORWARD
  const real* d;
  template <int N>
  In(const Numbers<N>& of, int first = 0) : x(of.x + first), d(of.d + first) {}
#else
  template <int N>
  In(const Numbers<N>& of, int first = 0) : x(of.x + first) {}
#endif
};

struct Out {
  real* x = nullptr;  // not wanted
#if FORWARD
  real* d = nullptr;
  Out() = default;
  template <int N>
  Out(Numbers<N>& of, int first = 0) : x(of.x + first), d(of.d + first) {}
#else
  Out() = default;
  template <int N>
  Out(Numbers<N>& of, int first = 0) : x(of.x + first) {}
#endif
};

template <auto FUNCTION, int I, int O>
inline __attribute__((always_inline)) void call(const In (&in)[I], const Out (&out)[O]) {
#if FORWARD
  const real* arg[2 * I];
  real* res[2 * O];
  for (int i = 0; i < I; ++i) arg[I + i] = in[i].d;
  for (int i = 0; i < O; ++i) res[O + i] = out[i].d;
#else
  const real* arg[I];
  real* res[O];
#endif
  for (int i = 0; i < I; ++i) arg[i] = in[i].x;
  for (int i = 0; i < O; ++i) res[i] = out[i].x;
  FUNCTION(arg, res, nullptr, nullptr, 0);
}

template <int N>
void clear(Numbers<N>& numbers) {
  for (int j = 0; j < N; ++j) {
    numbers.x[j] = 0;
#if FORWARD
    numbers.d[j] = 0;
#endif
  }
}

template <int N>
void copy(const Numbers<N>& from, int j, Numbers<N>& to) {
  to.x[j] = from.x[j];
#if FORWARD
  to.d[j] = from.d[j];
#endif
}

Numbers<1> constant(double value) {
  Numbers<1> number;
  clear(number);
  number.x[0] = value;
  return number;
}

// One stage of the integrator: accelerations of all joints, by one pass out, one in and one out over the links.
struct Stage {
  Numbers<DIMENSION * N_DRIVE> ends;
  Numbers<ANGLES> angles;
  Numbers<DRIVE_MOVING> drive_moving;
  Numbers<N_DRIVE> tau;
  Numbers<FRAME> frame[N_LINKS + 1];  // where each link begins; the last is the tip
  Numbers<NQ> qdd;

  // LED: the drive is where it was already, by an earlier stage at the same instant.
  template <bool FIRST, bool LED = false>
  void take(const Numbers<NX>& x, const Numbers<1>& t, const Numbers<1>& h, const Numbers<NP>& p,
            const Numbers<LINK>* w, const Numbers<N_INPUTS>& u, const Numbers<NQ>& before, const Numbers<1>& share) {
    Numbers<MOVING> moving[N_LINKS];
    Numbers<JOINT> joint[N_LINKS];
    Numbers<TORQUE> torque[N_LINKS];
    Numbers<ARMATURE> armature[N_LINKS];
    if constexpr (!LED)
      call<hand>({In(x, 0), In(x, NQ), p, u, In(before, 0), share}, {frame[0], ends, angles, drive_moving});
    for (int i = 0; i < N_LINKS; ++i) {
      const int j = N_DRIVE + LINK_SIZE * i;
      if constexpr (FIRST || EXPLICIT)
        call<outward>({frame[i], In(x, j), In(x, NQ + j), w[i], h}, {frame[i + 1], moving[i], torque[i], armature[i]});
#if !EXPLICIT
      else  // of the frames only what is needed to go on
        call<outward_again>({frame[i], In(x, j), In(x, NQ + j), w[i], h, In(before, j)},
                            {frame[i + 1], moving[i], torque[i], armature[i]});
#endif
    }
    Numbers<CARRIED> carried[N_LINKS + 1];  // by each link's joint; nothing at the tip
    Numbers<TWIST> twisting[N_LINKS + 1];
    clear(carried[N_LINKS]);
    call<twist>({frame[N_LINKS]}, {twisting[N_LINKS]});
    for (int i = N_LINKS - 1; i >= 0; --i)
      call<inward>({carried[i + 1], moving[i], w[i], torque[i], armature[i], twisting[i + 1]},
                   {carried[i], joint[i], twisting[i]});
    Numbers<ACCELERATION> at[N_LINKS + 1];
    const In moved[] = {t, h, In(x, 0), In(x, NQ), p, u, In(before, 0), drive_moving, carried[0]};
    if constexpr (FIRST || !PRESCRIBED)
      call<react>(moved, {Out(qdd, 0), at[0], tau});
    else  // nobody asks for later stages' torques
      call<react>(moved, {Out(qdd, 0), at[0], Out()});
    for (int i = 0; i < N_LINKS; ++i)
      call<accelerate>({at[i], joint[i], moving[i]}, {at[i + 1], Out(qdd, N_DRIVE + LINK_SIZE * i)});
  }

#if EXPLICIT
  // Puts the drive where it is in another stage.
  void lead_as(const Stage& other) {
    frame[0] = other.frame[0], ends = other.ends, angles = other.angles, drive_moving = other.drive_moving;
  }
#endif

  // Position and velocity of the tip, or of where another link begins: 0 is the hand.
  void tip(Numbers<TIP>& to, int link) const {
    for (int c = 0; c < TIP; ++c) {
      const int column = c < DIMENSION ? FRAME_place + c : FRAME_velocity + c - DIMENSION;
      to.x[c] = frame[link].x[column];
#if FORWARD
      to.d[c] = frame[link].d[column];
#endif
    }
  }

  // Column c of what is observed: all links' ends (coordinates of each in turn), then in the plane their angles.
  In observed(int64_t c) const {
    constexpr int LINKS = N_DRIVE + N_LINKS;
    if (c < DIMENSION * N_DRIVE) return In(ends, c);
    if (c < DIMENSION * LINKS) return In(frame[c / DIMENSION - N_DRIVE + 1], FRAME_place + c % DIMENSION);
    const int64_t i = c - DIMENSION * LINKS;
    return i < N_DRIVE ? In(angles, i) : In(frame[i - N_DRIVE + 1], FRAME_angle);
  }
};

// Nearest point of the segments between successive tip positions, each a place with its velocity behind it.
struct ClosestApproach {
  real squared = std::numeric_limits<double>::infinity();
  real time = 0, tip[TIP] = {}, slope = 0, dtip[TIP] = {};

  // Of these lanes: the segment that begins at time t and lasts h; d.. are the tips' derivatives.
  void segment(mask lanes, const real* from, const real* to, real t, real h, const real* target, const real* dfrom,
               const real* dto) {
    real d[DIMENSION], e[DIMENSION], g[DIMENSION], length2 = 0, along = 0, d2 = 0;
    for (int c = 0; c < DIMENSION; ++c) {
      d[c] = to[c] - from[c], e[c] = target[c] - from[c];
      length2 += d[c] * d[c], along += e[c] * d[c];
    }
    real s = along / select(length2 > 0, length2, real(1));
    s = select(s > 0, select(s < 1, s, real(1)), real(0));
    for (int c = 0; c < DIMENSION; ++c) g[c] = s * d[c] - e[c], d2 += g[c] * g[c];
    const mask nearer = lanes && (d2 < squared);
    if (!any_of(nearer)) return;
    squared = select(nearer, d2, squared);
    time = select(nearer, t + s * h, time);
    for (int i = 0; i < TIP; ++i) tip[i] = select(nearer, from[i] + s * (to[i] - from[i]), tip[i]);
#if FORWARD  // where along the segment drops out: there the distance is smallest
    const real distance = sqrt(d2);
    real change = 0;
    for (int c = 0; c < DIMENSION; ++c) change += g[c] * (dfrom[c] + s * (dto[c] - dfrom[c]));
    slope = select(nearer, change / select(distance > 0, distance, real(1)), slope);
    real dalong = 0, dlength2 = 0;
    for (int c = 0; c < DIMENSION; ++c) {
      const real dd = dto[c] - dfrom[c];
      dalong += e[c] * dd - dfrom[c] * d[c], dlength2 += 2 * d[c] * dd;
    }
    const mask between = s > 0 && s < 1;  // the nearest point moves along the segment
    const real ds = select(between, (dalong - s * dlength2) / select(between, length2, real(1)), real(0));
    for (int i = 0; i < TIP; ++i)
      dtip[i] = select(nearer, dfrom[i] + s * (dto[i] - dfrom[i]) + ds * (to[i] - from[i]), dtip[i]);
#else
    (void)dfrom, (void)dto;
#endif
  }

  // Of these lanes: the cubic through two tips and their velocities, from time t on for h; d.. are their derivatives.
  void curve(mask lanes, const real* from, const real* to, real t, real h, const real* target, const real* dfrom,
             const real* dto, real dh) {
    real to_start = 0, reach = 0, reach1 = 0, reach2 = 0;  // the curve is in the hull of its Bezier points
    for (int c = 0; c < DIMENSION; ++c) {
      const real third = h / 3, chord = to[c] - from[c], e = from[c] - target[c];
      const real one = third * from[DIMENSION + c], two = chord - third * to[DIMENSION + c];
      to_start += e * e, reach += chord * chord, reach1 += one * one, reach2 += two * two;
    }
    const real least = sqrt(to_start) - sqrt(fmax(reach, fmax(reach1, reach2)));
    if (!any_of(lanes && (least < sqrt(squared)))) return;
    real s = 0, best = to_start;
    constexpr int PARTS = 8;
    for (int k = 1; k <= PARTS; ++k) {
      const real at = k / static_cast<double>(PARTS), d2 = distance2(from, to, h, target, at);
      const mask nearer = d2 < best;
      best = select(nearer, d2, best), s = select(nearer, at, s);
    }
    const real low = fmax(s - 1. / PARTS, real(0)), high = fmin(s + 1. / PARTS, real(1));
    for (int k = 0; k < 6; ++k) {  // Newton's steps to where the distance's slope is zero
      real first, second;
      slopes(from, to, h, target, s, first, second);
      s = fmin(fmax(s - first / select(second > 0, second, real(1)), low), high);
    }
    const real d2 = distance2(from, to, h, target, s);
    const mask nearer = lanes && (d2 < squared);
    if (!any_of(nearer)) return;
    squared = select(nearer, d2, squared);
    time = select(nearer, t + s * h, time);
    const real r = 1 - s;
    real place[DIMENSION], along[DIMENSION], bend[DIMENSION];
    point(from, to, h, s, place, along, bend);
    for (int c = 0; c < DIMENSION; ++c) {
      tip[c] = select(nearer, place[c], tip[c]);
      tip[DIMENSION + c] = select(nearer, along[c] / h, tip[DIMENSION + c]);
    }
#if FORWARD  // where along the curve drops out: there the distance is smallest
    const real distance = sqrt(d2);
    real dplace[DIMENSION], dalong[DIMENSION], dbend[DIMENSION], change = 0, dfirst = 0, first, second;
    point(dfrom, dto, h, s, dplace, dalong, dbend);
    slopes(from, to, h, target, s, first, second);
    for (int c = 0; c < DIMENSION; ++c) {
      const real v0 = from[DIMENSION + c], v1 = to[DIMENSION + c];
      dplace[c] += dh * r * s * (r * v0 - s * v1);
      dalong[c] += dh * (r * (r - 2 * s) * v0 - s * (2 * r - s) * v1);
      change += (place[c] - target[c]) * dplace[c];
      dfirst += dplace[c] * along[c] + (place[c] - target[c]) * dalong[c];
    }
    slope = select(nearer, change / select(distance > 0, distance, real(1)), slope);
    const mask between = s > 0 && s < 1;  // the nearest point moves along the curve
    const real ds = select(between && (second > 0), -dfirst / select(second > 0, second, real(1)), real(0));
    for (int c = 0; c < DIMENSION; ++c) {
      dtip[c] = select(nearer, dplace[c] + ds * along[c], dtip[c]);
      const real dspeed = (dalong[c] + ds * bend[c] - along[c] / h * dh) / h;
      dtip[DIMENSION + c] = select(nearer, dspeed, dtip[DIMENSION + c]);
    }
#else
    (void)dfrom, (void)dto, (void)dh, (void)r, (void)bend;
#endif
  }

  // Place on the cubic at the share s of its time, and its first and second derivatives by s.
  static INLINED void point(const real* from, const real* to, real h, real s, real* place, real* along, real* bend) {
    const real r = 1 - s;
    for (int c = 0; c < DIMENSION; ++c) {
      const real chord = to[c] - from[c], v0 = h * from[DIMENSION + c], v1 = h * to[DIMENSION + c];
      place[c] = from[c] + s * s * (3 - 2 * s) * chord + r * s * (r * v0 - s * v1);
      along[c] = 6 * r * s * chord + r * (r - 2 * s) * v0 - s * (2 * r - s) * v1;
      bend[c] = (6 - 12 * s) * chord + (6 * s - 4) * v0 + (6 * s - 2) * v1;
    }
  }

  static INLINED real distance2(const real* from, const real* to, real h, const real* target, real s) {
    real place[DIMENSION], along[DIMENSION], bend[DIMENSION], d2 = 0;
    point(from, to, h, s, place, along, bend);
    for (int c = 0; c < DIMENSION; ++c) d2 += (place[c] - target[c]) * (place[c] - target[c]);
    return d2;
  }

  // First and second derivatives by s of half the squared distance.
  static INLINED void slopes(const real* from, const real* to, real h, const real* target, real s, real& first,
                             real& second) {
    real place[DIMENSION], along[DIMENSION], bend[DIMENSION];
    point(from, to, h, s, place, along, bend);
    first = 0, second = 0;
    for (int c = 0; c < DIMENSION; ++c) {
      const real e = place[c] - target[c];
      first += e * along[c], second += along[c] * along[c] + e * bend[c];
    }
  }
};

struct Strikes {  // what the caller gives and gets; arrays of rows, one per lane unless said otherwise
  const double *p, *x0, *target, *h, *h_last;
  const int64_t* steps;
  int64_t hold;                           // steps for which a torque is held
  const double *dp, *dx0, *dh, *dh_last;  // forward mode: the direction of each lane
  const double *u, *du;                   // rows of inputs, one per instant: of a lane, steps + 2
  const int64_t *u_row, *du_row;          // first row of each lane's inputs; du_row < 0: they do not move
  double* out;
  double* rows;              // trajectories, or null
  const int64_t* first_row;  // where each lane's rows begin
  double* path;              // tip path at equal times, or null: (lanes, samples, width), and derivatives behind it
  int64_t samples, moving;   // moving: a place has its velocity behind it, so that the width is TIP, else DIMENSION
  int64_t by_hand;           // the hand is followed in place of the tip
  double rate;             // [1/s]
  double *y, *dy;          // what is observed, or null: (rows, n_columns)
  const int64_t* columns;  // of what is observed, to keep
  int64_t n_columns, stride;
  const int64_t* y_row;  // first row of each lane's samples, `stride` steps apart
  const double* tolerance;  // of a step's error, one per lane [m], or null: steps are given
  const double* knot;       // when a lane's reference ends, which no step passes over [s]
  const double* weight;     // how far each coordinate (NQ) moves the tip [m]
  double period;            // for which a torque is held [s]
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

void inputs(real* to, const double* from, const int64_t* row, int64_t instant, const Strikes& io, int64_t first,
            int64_t count) {
  for (int l = 0; l < LANES; ++l) {
    const int64_t b = first + (l < count ? l : count - 1);
    const int64_t k = instant < io.steps[b] + 1 ? instant : io.steps[b] + 1;  // a lane that ended waits for the others
    for (int j = 0; j < N_INPUTS; ++j) set_lane(to[j], l, row[b] < 0 ? 0.0 : from[(row[b] + k) * N_INPUTS + j]);
  }
}

// LANES lanes of a batch at once.
struct Roll {
  const Strikes& io;
  const int64_t first, count;
  Numbers<NP> p;
  Numbers<LINK> w[N_LINKS];
  Numbers<NX> x;
  Numbers<N_INPUTS> u, u_end;
  Numbers<TIP> tip, before;
  Numbers<1> now, dt;
  real h, h_last, steps, elapsed, target[DIMENSION], fastest[N_DRIVE + !N_DRIVE], strongest[N_DRIVE + !N_DRIVE];
  real lowest[N_DRIVE + !N_DRIVE], highest[N_DRIVE + !N_DRIVE];
  Numbers<N_DRIVE> squared, effort;  // torques squared, and their integrals
#if FORWARD
  real dh, dh_last, delapsed, dstrongest[N_DRIVE + !N_DRIVE] = {};
#endif
  int64_t longest = 0, done[LANES];  // of each lane, the last instant that was asked for, or its steps
  real tolerance, knot, end, length, held;  // of a lane that chooses its steps: `held` counts periods of a held torque
#if FORWARD
  real dend;
#endif
  ClosestApproach closest;
  mask alive, diverged;  // lanes that still move; lanes that broke off

  Roll(const Strikes& io, int64_t first, int64_t count) : io(io), first(first), count(count) {
    fill(p, io.p);
    fill(x, io.x0);
    clear(u), clear(u_end), clear(before), clear(squared), clear(effort);
    for (int j = 0; j < DIMENSION; ++j) target[j] = gather(io.target, DIMENSION, first, count, j);
    for (int j = 0; j < N_DRIVE; ++j) {
      fastest[j] = strongest[j] = 0;
      lowest[j] = INFINITY, highest[j] = -INFINITY;
    }
    h = gather(io.h, 1, first, count, 0), h_last = gather(io.h_last, 1, first, count, 0);
#if FORWARD
    for (int j = 0; j < NP; ++j) p.d[j] = gather(io.dp, NP, first, count, j);
    for (int j = 0; j < NX; ++j) x.d[j] = gather(io.dx0, NX, first, count, j);
    dh = gather(io.dh, 1, first, count, 0), dh_last = gather(io.dh_last, 1, first, count, 0);
#endif
    for (int i = 0; i < N_LINKS; ++i)
      for (int j = 0; j < LINK; ++j) {
        const int column = LINK_FIRST[j] + i * LINK_STRIDE[j];
        w[i].x[j] = p.x[column];
#if FORWARD
        w[i].d[j] = p.d[column];
#endif
      }
    for (int l = 0; l < LANES; ++l) {
      const int64_t n = io.steps[first + (l < count ? l : count - 1)];
      set_lane(steps, l, static_cast<double>(n));
      longest = n > longest ? n : longest, done[l] = 0;
    }
    alive = h == h, diverged = !alive;
  }

  template <int N>
  void fill(Numbers<N>& to, const double* from) {
    for (int j = 0; j < N; ++j) to.x[j] = gather(from, N, first, count, j);
  }

  int followed() const { return io.by_hand ? 0 : N_LINKS; }

  static bool holds(mask lanes, int l) { return lane(select(lanes, real(1), real(0)), l) != 0; }

  void set_time(int64_t i) {
    const real k = static_cast<double>(i);
    const mask last = k + 1 == steps, end = k == steps;
    dt.x[0] = select(last, h_last, h);
    elapsed = select(end, h_last, h);  // the step that led here
    now.x[0] = select(end && k > 0, (k - 1) * h + h_last, k * h);
#if FORWARD
    dt.d[0] = select(last, dh_last, dh);
    delapsed = select(end, dh_last, dh);
    now.d[0] = select(end && k > 0, (k - 1) * dh + dh_last, k * dh);
#endif
  }

  void set_inputs(int64_t i) {
#if PRESCRIBED  // at later instants it is the last step's `u_end`
    if (i > 0) return;
    Numbers<N_DRIVE> q, v;
    call<lead>({now, p}, {q, v, u});
#elif HELD
    if (i % io.hold == 0) call<control>({x, now, p}, {u});
    u_end = u;
#else
    if (!N_INPUTS) return;
    inputs(u.x, io.u, io.u_row, i, io, first, count);
    inputs(u_end.x, io.u, io.u_row, i + 1, io, first, count);
#if FORWARD
    inputs(u.d, io.du, io.du_row, i, io, first, count);
    inputs(u_end.d, io.du, io.du_row, i + 1, io, first, count);
#endif
#endif
  }

  // What lanes that came to a new instant by a step show there; `begun`: not their first instant.
  void note(mask lanes, bool begun, const Stage& stage) {
    if (begun) {
#if FORWARD
      const real *dfrom = before.d, *dto = tip.d, dspan = delapsed;
#else
      const real *dfrom = nullptr, *dto = nullptr, dspan = 0;
#endif
      if (io.tolerance)
        closest.curve(lanes, before.x, tip.x, now.x[0] - elapsed, elapsed, target, dfrom, dto, dspan);
      else
        closest.segment(lanes, before.x, tip.x, now.x[0] - elapsed, elapsed, target, dfrom, dto);
    }
    for (int j = 0; j < N_DRIVE; ++j) {
      const real speed = abs(x.x[NQ + j]), torque = abs(stage.tau.x[j]);
      const mask stronger = lanes && torque > strongest[j];
      fastest[j] = select(lanes && speed > fastest[j], speed, fastest[j]);
      strongest[j] = select(stronger, torque, strongest[j]);
#if FORWARD
      dstrongest[j] = select(stronger, select(stage.tau.x[j] < 0, -stage.tau.d[j], stage.tau.d[j]), dstrongest[j]);
#endif
      lowest[j] = select(lanes && x.x[j] < lowest[j], x.x[j], lowest[j]);
      highest[j] = select(lanes && x.x[j] > highest[j], x.x[j], highest[j]);
    }
    add_effort(lanes, begun, stage.tau);
    for (int l = 0; l < LANES && l < count; ++l)
      if (io.path && holds(lanes, l)) write_path(begun, l);
  }

  // The instants of these lanes that the caller asked for.
  void write(mask lanes, const Stage& stage) {
    for (int l = 0; l < LANES && l < count; ++l) {
      if (!holds(lanes, l)) continue;
      if (io.rows) write_row(done[l], l, stage);
      if (io.y && done[l] % io.stride == 0) write_observed(done[l], l, stage);
    }
  }

  // Trapezoids between this instant and the one before.
  void add_effort(mask lanes, bool begun, const Numbers<N_DRIVE>& tau) {
    const real half = begun ? real(elapsed / 2) : real(0);
    for (int j = 0; j < N_DRIVE; ++j) {
      const real now2 = tau.x[j] * tau.x[j], sum = squared.x[j] + now2;
      effort.x[j] = select(lanes, effort.x[j] + half * sum, effort.x[j]);
      squared.x[j] = select(lanes, now2, squared.x[j]);
#if FORWARD
      const real dhalf = begun ? real(delapsed / 2) : real(0), dnow2 = 2 * tau.x[j] * tau.d[j];
      const real change = dhalf * sum + half * (squared.d[j] + dnow2);
      effort.d[j] = select(lanes, effort.d[j] + change, effort.d[j]);
      squared.d[j] = select(lanes, dnow2, squared.d[j]);
#endif
    }
  }

  void write_row(int64_t i, int l, const Stage& stage) const {
    double* row = io.rows + (io.first_row[first + l] + i) * ROW;
    row[ROW_t] = lane(now.x[0], l);
    for (int j = 0; j < NX; ++j) row[ROW_x + j] = lane(x.x[j], l);
    for (int j = 0; j < N_DRIVE; ++j) row[ROW_tau + j] = lane(stage.tau.x[j], l);
    for (int j = 0; j < TIP; ++j) row[ROW_tip + j] = lane(tip.x[j], l);
  }

  void write_observed(int64_t i, int l, const Stage& stage) const {
    const int64_t row = (io.y_row[first + l] + i / io.stride) * io.n_columns;
    for (int64_t c = 0; c < io.n_columns; ++c) {
      const In seen = stage.observed(io.columns[c]);
      io.y[row + c] = lane(*seen.x, l);
#if FORWARD
      io.dy[row + c] = lane(*seen.d, l);
#endif
    }
  }

  void write_path(bool begun, int l) const {
    const double t = lane(now.x[0], l), span = lane(elapsed, l), start = begun ? t - span : t;
    const int width = io.moving ? TIP : DIMENSION;
    int64_t sample = begun ? static_cast<int64_t>(std::floor(start * io.rate + 1e-9)) + 1 : 0;
    for (; sample < io.samples && sample <= t * io.rate + 1e-9; ++sample) {
      const double s = begun ? (sample / io.rate - start) / span : 0, r = 1 - s;
      double* point = io.path + ((first + l) * io.samples + sample) * (FORWARD ? 2 * width : width);
      const Numbers<TIP>& from = begun ? before : tip;
      for (int c = 0; c < DIMENSION; ++c) {
        const double p0 = lane(from.x[c], l), v0 = lane(from.x[DIMENSION + c], l);
        const double p1 = lane(tip.x[c], l), v1 = lane(tip.x[DIMENSION + c], l);
        const double along = 6 * r * s * (p1 - p0) + span * (r * (r - 2 * s) * v0 - s * (2 * r - s) * v1);
        point[c] = hermite(p0, v0, p1, v1, span, s);
        if (io.moving) point[DIMENSION + c] = begun ? along / span : v0;
#if FORWARD  // at a fixed time: the step that holds it moves with the strike's duration
        const double dstart = begun ? lane(now.d[0] - delapsed, l) : lane(now.d[0], l), dspan = lane(delapsed, l);
        const double ds = begun ? -(dstart + s * dspan) / span : 0;
        const double q0 = lane(from.d[c], l), w0 = lane(from.d[DIMENSION + c], l);
        const double q1 = lane(tip.d[c], l), w1 = lane(tip.d[DIMENSION + c], l);
        point[width + c] = hermite(q0, w0, q1, w1, span, s) + ds * along + dspan * r * s * (r * v0 - s * v1);
        if (!io.moving) continue;
        const double bend = (6 - 12 * s) * (p1 - p0) + span * ((6 * s - 4) * v0 + (6 * s - 2) * v1);
        const double dalong = 6 * r * s * (q1 - q0) + span * (r * (r - 2 * s) * w0 - s * (2 * r - s) * w1) +
                              dspan * (r * (r - 2 * s) * v0 - s * (2 * r - s) * v1) + ds * bend;
        point[width + DIMENSION + c] = begun ? (dalong - along / span * dspan) / span : w0;
#endif
      }
    }
  }

  // Lanes whose next state is wild break off; what ended or broke off stands still.
  void move_to(const Numbers<NX>& next) {
    real speed2 = 0;
    for (int j = NQ; j < NX; ++j) speed2 += next.x[j] * next.x[j];
    const mask wild = alive && !(speed2 < FASTEST * FASTEST);  // also true of NaN
    diverged = diverged || wild;
    alive = alive && !wild;
    for (int j = 0; j < NX; ++j) x.x[j] = select(alive, next.x[j], x.x[j]);
    for (int j = 0; j < TIP; ++j) before.x[j] = select(alive, tip.x[j], before.x[j]);
#if FORWARD
    for (int j = 0; j < NX; ++j) x.d[j] = select(alive, next.d[j], x.d[j]);
    for (int j = 0; j < TIP; ++j) before.d[j] = select(alive, tip.d[j], before.d[j]);
#endif
  }

  void write_outcome() const {
    for (int l = 0; l < LANES && l < count; ++l) {
      double* out = io.out + (first + l) * OUT;
      out[OUT_distance] = std::sqrt(lane(closest.squared, l));
      out[OUT_time] = lane(closest.time, l);
      for (int c = 0; c < DIMENSION; ++c) {
        out[OUT_tip + c] = lane(closest.tip[c], l);
        out[OUT_velocity + c] = lane(closest.tip[DIMENSION + c], l);
      }
      out[OUT_diverged] = lane(select(diverged, real(1), real(0)), l);
      out[OUT_last_step] = static_cast<double>(done[l]);
      out[OUT_slope] = lane(closest.slope, l);
      for (int c = 0; c < DIMENSION; ++c) {
        out[OUT_tip_slope + c] = lane(closest.dtip[c], l);
        out[OUT_velocity_slope + c] = lane(closest.dtip[DIMENSION + c], l);
      }
      for (int j = 0; j < N_DRIVE; ++j) {
        out[OUT_max_joint_speed + j] = lane(fastest[j], l);
        out[OUT_max_torque + j] = lane(strongest[j], l);
        out[OUT_lowest + j] = lane(lowest[j], l);
        out[OUT_highest + j] = lane(highest[j], l);
        out[OUT_effort + j] = lane(effort.x[j], l);
#if FORWARD
        out[OUT_effort_slope + j] = lane(effort.d[j], l);
        out[OUT_max_torque_slope + j] = lane(dstrongest[j], l);
#else
        out[OUT_effort_slope + j] = out[OUT_max_torque_slope + j] = 0;
#endif
      }
    }
  }

#if EXPLICIT
  // Adds a stage's share to the mean speeds and accelerations of the links.
  void share(Numbers<NX>& mean, double weight, const Numbers<NX>& at, const Numbers<NQ>& qdd) const {
    for (int j = N_DRIVE; j < NQ; ++j) {
      mean.x[j] += weight * at.x[NQ + j], mean.x[NQ + j] += weight * qdd.x[j];
#if FORWARD
      mean.d[j] += weight * at.d[NQ + j], mean.d[NQ + j] += weight * qdd.d[j];
#endif
    }
  }

  // The state a step later, by the classical Runge-Kutta method; `later` ends as the stage at the step's end,
  // and `last` as the state there.
  void runge_kutta(const Stage& one, Stage& later, Numbers<NX>& next, Numbers<NX>& last) {
    constexpr double AT[] = {0.5, 0.5, 1}, WEIGHT[] = {1 / 3., 1 / 3., 1 / 6.};
    Numbers<NX> mean, ahead = x;
    Numbers<NQ> k = one.qdd, none;
    clear(mean), clear(none);
    share(mean, 1 / 6., x, k);
    for (int s = 0; s < 3; ++s) {
      Numbers<1> t, part;
      part.x[0] = AT[s] * dt.x[0], t.x[0] = now.x[0] + part.x[0];
#if FORWARD
      part.d[0] = AT[s] * dt.d[0], t.d[0] = now.d[0] + part.d[0];
#endif
      Numbers<NX> to;
      if (s == 1)
        for (int j = 0; j < N_DRIVE; ++j) copy(ahead, j, to), copy(ahead, NQ + j, to);
      else
        call<lead>({t, p}, {Out(to, 0), Out(to, NQ), u_end});
      for (int j = N_DRIVE; j < NQ; j += LINK_SIZE)
        call<follow_link>({In(x, j), In(x, NQ + j), In(ahead, NQ + j), In(k, j), part}, {Out(to, j), Out(to, NQ + j)});
      if (s == 1)  // at the instant of the stage before
        later.take<false, true>(to, t, part, p, w, u_end, none, constant(0));
      else
        later.take<false>(to, t, part, p, w, u_end, none, constant(0));
      ahead = to, k = later.qdd;
      share(mean, WEIGHT[s], ahead, k);
    }
    for (int j = 0; j < N_DRIVE; ++j) copy(ahead, j, next), copy(ahead, NQ + j, next);
    for (int j = N_DRIVE; j < NQ; j += LINK_SIZE)
      call<follow_link>({In(x, j), In(x, NQ + j), In(mean, j), In(mean, NQ + j), dt}, {Out(next, j), Out(next, NQ + j)});
    last = ahead;
  }
#else
  // The state a step later, by the Rosenbrock-W method.
  void rosenbrock(const Stage& one, Numbers<NX>& next) {
    Stage two;
    Numbers<NX> ahead;
    Numbers<1> later;
    later.x[0] = now.x[0] + dt.x[0];
#if FORWARD
    later.d[0] = now.d[0] + dt.d[0];
#endif
#if PRESCRIBED
    call<lead>({later, p}, {Out(ahead, 0), Out(ahead, NQ), u_end});
#else
    for (int j = 0; j < N_DRIVE; ++j)
      call<predict>({In(x, j), In(x, NQ + j), In(one.qdd, j), dt}, {Out(ahead, j), Out(ahead, NQ + j)});
#endif
    for (int j = N_DRIVE; j < NQ; j += LINK_SIZE)
      call<predict_link>({In(x, j), In(x, NQ + j), In(one.qdd, j), dt}, {Out(ahead, j), Out(ahead, NQ + j)});
    two.take<false>(ahead, later, dt, p, w, u_end, one.qdd, constant(1));
    for (int j = N_DRIVE; j < NQ; j += LINK_SIZE)
      call<advance_link>({In(x, j), In(x, NQ + j), In(one.qdd, j), In(two.qdd, j), dt},
                         {Out(next, j), Out(next, NQ + j)});
#if PRESCRIBED
    for (int j = 0; j < N_DRIVE; ++j) copy(ahead, j, next), copy(ahead, NQ + j, next);
#else
    for (int j = 0; j < N_DRIVE; ++j)
      call<advance>({In(x, j), In(x, NQ + j), In(one.qdd, j), In(two.qdd, j), dt}, {Out(next, j), Out(next, NQ + j)});
#endif
  }
#endif

  // Steps that the caller gives, of all lanes together.
  void run_steps() {
    Stage one;
#if EXPLICIT
    Stage later;
#endif
    Numbers<NQ> none;
    clear(none);
    for (int64_t i = 0; i <= longest; ++i) {  // one first stage more than steps: the final state has a tip, too
      set_time(i);
      set_inputs(i);
#if EXPLICIT
      if (i > 0) {  // the last step's end
        one.lead_as(later);
        one.take<true, true>(x, now, dt, p, w, u, none, constant(0));
      } else
#endif
        one.take<true>(x, now, dt, p, w, u, none, constant(0));
      one.tip(tip, followed());
      note(alive, i > 0, one);
      for (int l = 0; l < LANES; ++l)
        if (holds(alive, l)) done[l] = i;
      write(alive, one);
      alive = alive && !(real(static_cast<double>(i)) == steps);
      if (!any_of(alive)) break;
      Numbers<NX> next;
#if EXPLICIT
      Numbers<NX> last;
      runge_kutta(one, later, next, last);
#else
      rosenbrock(one, next);
#endif
#if PRESCRIBED
      u = u_end;
#endif
      move_to(next);
    }
  }

  // Time of the next instant that no step passes over: the reference's or the strike's end, a new torque to hold, an
  // instant that the caller asked for.
  Numbers<1> next_event() const {
    Numbers<1> event;
    event.x[0] = select(now.x[0] < knot, fmin(knot, end), end);
#if FORWARD
    event.d[0] = dend;  // the reference's end moves as the strike's
#endif
    for (int l = 0; l < LANES; ++l) {
      if (HELD) sooner(event, l, (lane(held, l) + 1) * io.period, 0);
#if FORWARD
      if (gridded()) sooner(event, l, (done[l] + 1) * lane(h, l), (done[l] + 1) * lane(dh, l));
#else
      if (gridded()) sooner(event, l, (done[l] + 1) * lane(h, l), 0);
#endif
    }
    return event;
  }

  static void sooner(Numbers<1>& event, int l, double t, double dt) {
    if (!(t < lane(event.x[0], l) * (1 - 1e-12))) return;
    set_lane(event.x[0], l, t);
#if FORWARD
    set_lane(event.d[0], l, dt);
#else
    (void)dt;
#endif
  }

  bool gridded() const { return io.rows || io.y; }

  // Sets the step, to the event where it is not farther than `length`, half the way where it is not twice as far.
  // Returns when it ends.
  Numbers<1> choose_step() {
    Numbers<1> event = next_event(), then;
    const real left = event.x[0] - now.x[0];
    const mask lands = length >= left * (1 - 1e-9), halves = 2 * length > left;
    const real share = select(lands, real(1), select(halves, real(0.5), real(0)));
    dt.x[0] = select(lands || halves, share * left, length);
    then.x[0] = select(lands, event.x[0], now.x[0] + dt.x[0]);
#if FORWARD
    // all steps up to the event stretch alike, as it moves
    dt.d[0] = dt.x[0] / select(left > 0, left, real(1)) * (event.d[0] - now.d[0]);
    then.d[0] = select(lands, event.d[0], now.d[0] + dt.d[0]);
#endif
    return then;
  }

#if HELD
  // Lanes whose period is over get a new torque.
  void set_torques() {
    real period = 0;
    for (int l = 0; l < LANES; ++l) set_lane(period, l, std::floor(lane(now.x[0], l) / io.period + 1e-9));
    const mask over = period > held;
    if (!any_of(over)) return;
    Numbers<N_INPUTS> torque;
    call<control>({x, now, p}, {torque});
    for (int j = 0; j < N_INPUTS; ++j) take_over(over, torque, j, u, j);
    held = select(over, period, held), u_end = u;
  }
#endif

  template <int N, int M>
  static void take_over(mask lanes, const Numbers<N>& from, int i, Numbers<M>& to, int j) {
    to.x[j] = select(lanes, from.x[i], to.x[j]);
#if FORWARD
    to.d[j] = select(lanes, from.d[i], to.d[j]);
#endif
  }

  // Lanes are at a new instant, or at their first.
  void arrive(mask lanes, bool begun, const Stage& stage) {
    Numbers<TIP> there;
    stage.tip(there, followed());
    for (int j = 0; j < TIP; ++j) take_over(lanes, there, j, tip, j);
    note(lanes, begun, stage);
    mask wanted = lanes;
    for (int l = 0; begun && l < LANES; ++l) {
      const double t = lane(now.x[0], l);
      const bool asked = !gridded() || t == (done[l] + 1) * lane(h, l) || t >= lane(end, l);
      if (asked && holds(lanes, l))
        ++done[l];
      else
        wanted = wanted && !only(l);
    }
    write(wanted, stage);
    alive = alive && !(lanes && now.x[0] >= end);
  }

  static mask only(int l) {
    real one = 0;
    set_lane(one, l, 1);
    return one > 0;
  }

  // Which lanes' steps are good enough, by the squares of their errors [m^2]; sets the length of the next ones.
  mask judge(const Numbers<NX>& next, real squared_error) {
    real speed2 = 0, growth = 0;
    for (int j = NQ; j < NX; ++j) speed2 += next.x[j] * next.x[j];
    const real error = sqrt(squared_error) / tolerance;
    const mask calm = speed2 < FASTEST * FASTEST, shortest = dt.x[0] <= SHORTEST;  // calm: not of NaN
    // where a force has a kink no step is short enough for its estimate, and the shortest is taken
    const mask good = alive && calm && (error <= 1 || shortest);
    for (int l = 0; l < LANES; ++l) {
      const double e = lane(error, l), wanted = 0.9 * std::pow(e, -1.0 / ERROR_ORDER);
      set_lane(growth, l, holds(calm, l) && wanted > 0.2 ? std::fmin(wanted, 4) : 0.2);
    }
    const real following = fmin(dt.x[0] * growth, real(LONGEST));
    length = select(good && dt.x[0] < length, fmax(length, following), following);  // a step may be cut short
    const mask lost = alive && !calm && shortest;
    diverged = diverged || lost, alive = alive && !lost;
    return good;
  }

  void step_to(mask good, const Numbers<NX>& next, const Numbers<1>& then) {
    elapsed = select(good, dt.x[0], elapsed);
#if FORWARD
    delapsed = select(good, dt.d[0], delapsed);
#endif
    take_over(good, then, 0, now, 0);
    for (int j = 0; j < NX; ++j) take_over(good, next, j, x, j);
    for (int j = 0; j < TIP; ++j) take_over(good, tip, j, before, j);
  }

  // The square of an error of one coordinate and its speed, as places [m].
  real square(int j, real position, real speed) const {
    return io.weight[j] * io.weight[j] * (position * position + SPAN * SPAN * speed * speed);
  }

#if EXPLICIT
  // How far the classical method is from the one of third order that has the next step's first stage in place of the
  // last; Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, Sect. II.4.
  real squared_error(const Numbers<NX>& last, const Numbers<NQ>& k, const Numbers<NX>& next, const Numbers<NQ>& following) {
    real sum = 0;
    for (int j = N_DRIVE; j < NQ; ++j)
      sum += square(j, dt.x[0] / 6 * (last.x[NQ + j] - next.x[NQ + j]), dt.x[0] / 6 * (k.x[j] - following.x[j]));
    return sum;
  }
#else
  // The state a step later by a Rosenbrock-W method of third order, and the squared distance from one of second order.
  real rosenbrock_third(const Stage& one, const Numbers<1>& damped, Numbers<NX>& next) {
    Stage stage;
    Numbers<NQ> k[STAGES], v[STAGES];
    k[0] = one.qdd;
    for (int j = 0; j < NQ; ++j) copy_speed(x, j, v[0]);
    for (int s = 1; s < STAGES; ++s) {
      Numbers<NQ> speed, change, back;
      Numbers<NX> at;
      Numbers<1> t = now, share = constant(0);
      combine(v, s, W_A[s], speed), combine(k, s, W_A[s], change), combine(k, s, W_BACK[s], back);
      for (int i = 0; i < s; ++i) t.x[0] += W_A[s][i] * dt.x[0], share.x[0] += W_BACK[s][i];
#if FORWARD
      for (int i = 0; i < s; ++i) t.d[0] += W_A[s][i] * dt.d[0];
#endif
      follow(t, speed, change, at);
      stage.take<false>(at, t, damped, p, w, u_end, back, share);
      k[s] = stage.qdd;
      for (int j = 0; j < NQ; ++j) copy_speed(at, j, v[s]);
    }
    Numbers<NQ> speed, change, speed_error, change_error;
    combine(v, STAGES, W_B, speed), combine(k, STAGES, W_B, change);
    combine(v, STAGES, W_ERROR, speed_error), combine(k, STAGES, W_ERROR, change_error);
    Numbers<1> then = now;
    then.x[0] += dt.x[0];
#if FORWARD
    then.d[0] += dt.d[0];
#endif
    follow(then, speed, change, next);
    real sum = 0;
    for (int j = PRESCRIBED ? N_DRIVE : 0; j < NQ; ++j)
      sum += square(j, dt.x[0] * speed_error.x[j], dt.x[0] * change_error.x[j]);
    return sum;
  }

  static void copy_speed(const Numbers<NX>& from, int j, Numbers<NQ>& to) {
    to.x[j] = from.x[NQ + j];
#if FORWARD
    to.d[j] = from.d[NQ + j];
#endif
  }

  static void combine(const Numbers<NQ>* of, int count, const double* weights, Numbers<NQ>& sum) {
    clear(sum);
    for (int i = 0; i < count; ++i) {
      if (weights[i] == 0) continue;
      for (int j = 0; j < NQ; ++j) {
        sum.x[j] += weights[i] * of[i].x[j];
#if FORWARD
        sum.d[j] += weights[i] * of[i].d[j];
#endif
      }
    }
  }

  // The state (NX) at time t, at such mean speeds and accelerations of the step.
  void follow(const Numbers<1>& t, const Numbers<NQ>& speed, const Numbers<NQ>& change, Numbers<NX>& to) {
#if PRESCRIBED
    call<lead>({t, p}, {Out(to, 0), Out(to, NQ), u_end});
#else
    for (int j = 0; j < N_DRIVE; ++j) {
      to.x[j] = x.x[j] + dt.x[0] * speed.x[j], to.x[NQ + j] = x.x[NQ + j] + dt.x[0] * change.x[j];
#if FORWARD
      to.d[j] = x.d[j] + dt.x[0] * speed.d[j] + dt.d[0] * speed.x[j];
      to.d[NQ + j] = x.d[NQ + j] + dt.x[0] * change.d[j] + dt.d[0] * change.x[j];
#endif
    }
#endif
    for (int j = N_DRIVE; j < NQ; j += LINK_SIZE)
      call<follow_link>({In(x, j), In(x, NQ + j), In(speed, j), In(change, j), dt}, {Out(to, j), Out(to, NQ + j)});
  }
#endif

  // Steps as long as their errors allow, of each lane its own.
  void run_adapted() {
    Stage one;
    Numbers<NQ> none;
    clear(none), clear(now), clear(dt);
    tolerance = gather(io.tolerance, 1, first, count, 0), knot = gather(io.knot, 1, first, count, 0);
    end = (steps - 1) * h + h_last, length = fmin(real(FIRST), end), held = -1, elapsed = 0;
#if FORWARD
    dend = (steps - 1) * dh + dh_last, delapsed = 0;
#endif
#if EXPLICIT
    Stage later;
    set_inputs(0);
    one.take<true>(x, now, dt, p, w, u, none, constant(0));
    arrive(alive, false, one);
#else
    mask fresh = alive;
#endif
    for (int64_t i = 0; i < MOST_STEPS && any_of(alive); ++i) {
      Numbers<NX> next;
#if EXPLICIT
      const Numbers<1> then = choose_step();
      const Numbers<NQ> k = one.qdd;
      Numbers<NX> last;
      runge_kutta(one, later, next, last);
      one.lead_as(later);
      one.take<true, true>(next, then, dt, p, w, u_end, none, constant(0));
      const mask good = judge(next, squared_error(last, later.qdd, next, one.qdd));
      step_to(good, next, then);
      arrive(good, true, one);
      for (int j = 0; j < NQ; ++j) take_over(!good, k, j, one.qdd, j);
#else
#if HELD
      set_torques();
#elif PRESCRIBED
      set_inputs(0);
#endif
      const Numbers<1> then = choose_step();
      Numbers<1> damped = dt;
      damped.x[0] *= W_WIDER;
#if FORWARD
      damped.d[0] *= W_WIDER;
#endif
      one.take<true>(x, now, damped, p, w, u, none, constant(0));
      arrive(alive && fresh, i > 0, one);
      if (!any_of(alive)) break;
      const real error2 = rosenbrock_third(one, damped, next);
      fresh = judge(next, error2);
      step_to(fresh, next, then);
#endif
    }
    diverged = diverged || alive;
  }

  void run() {
    if (io.tolerance)
      run_adapted();
    else
      run_steps();
    write_outcome();
  }
};

}  // namespace

extern "C" __attribute__((visibility("default"))) int whiptool_lanes() { return LANES; }

extern "C" __attribute__((visibility("default"))) void whiptool_roll(const Strikes* io, int64_t first, int64_t count) {
  for (int64_t b = first; b < first + count; b += LANES) {
    const int64_t left = first + count - b;
    Roll(*io, b, left < LANES ? left : LANES).run();
  }
}
