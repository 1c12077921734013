// Sine and cosine of every lane; those of one strike alone are the library's.
//
// An angle is taken to the nearest multiple of pi/2, which is subtracted in three parts (Cody and Waite 1980): the first
// two have 33 bits, so that their products with the multiple are exact. What is left, at most pi/4, goes into minimax
// polynomials, of relative errors below 2^-57. Up to angles of 1e5 rad, results are within 2 units in the last place.
#if SIMD

namespace {

struct Reduced {
  real rest;      // [-pi/4, pi/4]
  Bits quadrant;  // multiples of pi/2 that were subtracted; the last two bits count
};

INLINED Reduced reduced(real angle) {
  constexpr double INTEGER = 0x1.8p52;  // a number added to it is rounded, and stands in its last bits
  const Doubles shifted = angle.lanes * 0x1.45f306dc9c883p-1 + INTEGER;
  const real multiple = shifted - INTEGER;
  const real rest = angle - multiple * 0x1.921fb544p+0 - multiple * 0x1.0b4611a6p-34 - multiple * 0x1.3198a2e037073p-69;
  return {rest, reinterpret_cast<Bits>(shifted)};
}

INLINED real sine_of_rest(real x) {
  const real z = x * x;
  real p = 0x1.5d8fa31eaab18p-33;
  p = p * z + -0x1.ae5e59f595799p-26;
  p = p * z + 0x1.71de3567125ecp-19;
  p = p * z + -0x1.a01a019bfd181p-13;
  p = p * z + 0x1.111111110f7cap-7;
  p = p * z + -0x1.5555555555548p-3;
  return x + x * z * p;
}

INLINED real cosine_of_rest(real x) {
  const real z = x * x;
  real p = -0x1.8fa465e50a043p-37;
  p = p * z + 0x1.1ee9d7527e425p-29;
  p = p * z + -0x1.27e4f7ea37780p-22;
  p = p * z + 0x1.a01a019c8390dp-16;
  p = p * z + -0x1.6c16c16c14f8ap-10;
  p = p * z + 0x1.555555555554bp-5;
  return 1.0 - 0.5 * z + z * z * p;
}

// The sine of an angle a number of quadrants further.
INLINED real sine_further(real angle, int quadrants) {
  const Reduced r = reduced(angle);
  const Bits quadrant = r.quadrant + quadrants;
  const real value = select((quadrant & 1) != 0, cosine_of_rest(r.rest), sine_of_rest(r.rest));
  return select((quadrant & 2) != 0, -value, value);
}

INLINED real sin(real angle) { return sine_further(angle, 0); }
INLINED real cos(real angle) { return sine_further(angle, 1); }

}  // namespace
#endif
