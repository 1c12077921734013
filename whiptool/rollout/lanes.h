// The number type of the driver, `real`, and its comparisons, `mask`: a strike in each lane of a SIMD register, or one
// strike alone. SIMD is 0 or 1 on the command line.
//
// Vectors are the compiler's own: a header such as <experimental/simd> would take longer to compile than the driver.
#include <math.h>

#define INLINED inline __attribute__((always_inline))

#if SIMD
#if defined(__AVX512F__)
constexpr int LANES = 8;
#elif defined(__AVX__)
constexpr int LANES = 4;
#else
constexpr int LANES = 2;
#endif

namespace {

typedef double Doubles __attribute__((vector_size(sizeof(double) * LANES)));
using Bits = decltype(Doubles{} < Doubles{});

struct mask {
  Bits bits;
  mask() = default;
  INLINED mask(Bits bits) : bits(bits) {}
};

struct real {
  Doubles lanes;
  real() = default;
  INLINED real(double x) : lanes(x - Doubles{}) {}
  INLINED real(int x) : real(static_cast<double>(x)) {}
  INLINED real(Doubles lanes) : lanes(lanes) {}
};

INLINED mask operator&&(mask a, mask b) { return a.bits & b.bits; }
INLINED mask operator||(mask a, mask b) { return a.bits | b.bits; }
INLINED mask operator!(mask a) { return ~a.bits; }
INLINED bool any_of(mask a) {
  bool any = false;
  for (int l = 0; l < LANES; ++l) any |= a.bits[l] != 0;
  return any;
}

INLINED real operator-(real a) { return -a.lanes; }
INLINED real operator+(real a, real b) { return a.lanes + b.lanes; }
INLINED real operator-(real a, real b) { return a.lanes - b.lanes; }
INLINED real operator*(real a, real b) { return a.lanes * b.lanes; }
INLINED real operator/(real a, real b) { return a.lanes / b.lanes; }
INLINED real& operator+=(real& a, real b) { return a = a + b; }
INLINED real& operator-=(real& a, real b) { return a = a - b; }
INLINED real& operator*=(real& a, real b) { return a = a * b; }
INLINED real& operator/=(real& a, real b) { return a = a / b; }
INLINED mask operator<(real a, real b) { return a.lanes < b.lanes; }
INLINED mask operator>(real a, real b) { return a.lanes > b.lanes; }
INLINED mask operator<=(real a, real b) { return a.lanes <= b.lanes; }
INLINED mask operator>=(real a, real b) { return a.lanes >= b.lanes; }
INLINED mask operator==(real a, real b) { return a.lanes == b.lanes; }

INLINED real select(mask m, real a, real b) { return m.bits ? a.lanes : b.lanes; }
INLINED real abs(real a) { return select(a < 0, -a, a); }
INLINED real fmax(real a, real b) { return select(a > b, a, b); }
INLINED real fmin(real a, real b) { return select(a < b, a, b); }

INLINED real sqrt(real a) {
  for (int l = 0; l < LANES; ++l) a.lanes[l] = __builtin_sqrt(a.lanes[l]);
  return a;
}

inline double lane(const real& x, int l) { return x.lanes[l]; }
inline void set_lane(real& x, int l, double value) { x.lanes[l] = value; }

}  // namespace
#else
using real = double;
using mask = bool;
constexpr int LANES = 1;
inline real select(mask m, real a, real b) { return m ? a : b; }
inline bool any_of(mask m) { return m; }
inline double lane(const real& x, int) { return x; }
inline void set_lane(real& x, int, double value) { x = value; }
#endif
