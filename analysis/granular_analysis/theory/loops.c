/* Loops over contacts, compiled if there is a compiler (loops.py).

   The reference of each loop is a NumPy version beside its caller in Python. The loop has the same formulas, in one
   pass in place of dozens. It sums in another order and so rounds differently. */

#ifndef NUMBER
#include <complex.h>
#include <math.h>
#include <stddef.h>

typedef ptrdiff_t whole; /* intp of NumPy */

/* Use the widest vectors of the processor; without fused multiply-adds all widths give the same bits. PLAIN uses none:
   a test compiles it in a third of the time. */
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(PLAIN)
#define VECTORS __attribute__((target_clones("avx512f", "avx2", "default")))
#define INLINE static inline __attribute__((always_inline))
#else
#define INLINE static inline
#define VECTORS
#endif

/* Pairs of `network_state.Pairs` under any law, in d = 2 or 3 dimensions with T = d − 1 tangents. `loss` is √5 ζ of a
   restitution, negative without one; `step` is the length of a step of velocity Verlet, or 0 for rates alone. */
typedef struct {
  whole spheres, pairs, dimension, jkr, incremental, shear, adheres;
  double friction, viscosity, loss, step;
  const whole *first, *second;
  const double *apart, *length, *overlap, *radii, *shortened, *mass, *A, *B, *F, *frame;
  unsigned char *begun;
} Contacts;

INLINE double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* Normal force of a contact: `network_laws.py` */
typedef struct {
  double closed, overlap, radius, repulsion, spreading;
} Normal;

INLINE Normal normal_of(whole jkr, double depth, double A, double F, int begun)
{
  if (!jkr) {
    const double closed = depth > 0, overlap = closed ? depth : 0, root = sqrt(overlap);
    return (Normal){closed, overlap, root, A * overlap * root - F * closed, 2 * overlap};
  }
  const double unit = cbrt(9 * F / A * F / A) / 3, x = depth / unit;
  if (!(depth > 0 || (begun && x > -cbrt(1.0 / 16)))) return (Normal){0};
  const double fourth = 4 * x / 9, one = cbrt(2.0 / 9 + sqrt(4.0 / 81 + fourth * fourth * fourth));
  const double u = one - fourth / one, guess = (sqrt(u) + sqrt(4 / (3 * sqrt(u)) - u)) / 2, cube = guess * guess * guess;
  const double s = guess - (3 * cube * guess - 2 * guess - x) / (12 * cube - 2), y = s * s * s;
  return (Normal){1, depth, sqrt(3 * unit) * s * s, 3 * F * (y * y - y), unit * (6 * s * y - s)};
}

/* Tangents along[a] of a normal, about[a] = n × along[a], and lean[a]: `network_tangents.py` */
INLINE void tangents(const Contacts *c, whole d, whole m, const double *n, double along[2][3], double about[2][3],
                     double *lean)
{
  const double plane[2][2][3] = {{{-n[1], n[0], 0}}, {{0, 0, 1}}};
  for (int a = 0; a < 2; a++)
    for (int k = 0; k < 3; k++) {
      along[a][k] = plane[0][a][k];
      about[a][k] = plane[1][a][k];
    }
  if (d == 2) return;
  double frame[3][3];
  for (int e = 0; e < 3; e++)
    for (int k = 0; k < 3; k++) frame[e][k] = c->frame[(3 * e + k) * c->pairs + m];
  for (int a = 0; a < 2; a++) {
    lean[a] = dot(frame[a], n) / (1 + dot(frame[2], n));
    for (int k = 0; k < 3; k++) along[a][k] = frame[a][k] - lean[a] * (n[k] + frame[2][k]);
  }
  for (int k = 0; k < 3; k++) {
    about[0][k] = along[1][k];
    about[1][k] = -along[0][k];
  }
}

/* `touched` with the dimension and the law of adhesion as constants, for the compiler */
INLINE double met(const Contacts *c, const double *motion, const double *memory, double *load, double *memory_rate,
                  whole *changes, const whole d, const whole jkr)
{
  const whole N = c->spheres, M = c->pairs, T = d - 1, f = d == 2 ? 3 : 6;
  const whole turn = d == 2 ? 2 : 0; /* first rotation that spheres have, of those about x, y and z */
  const int slides = c->friction < INFINITY;
  const double step = c->step;
  double power = 0;
  *changes = 0;
  for (whole i = 0; i < f * N; i++) load[i] = 0;
  for (whole m = 0; m < M; m++) {
    const whole i = c->first[m], j = c->second[m];
    const double R = c->radii[m], Q = c->radii[M + m], A = c->A[m], F = c->F[m];
    double way[3] = {0}, rate[3] = {0}, turning[3] = {0}, spins[3] = {0}, now[3] = {0}, both[3] = {0};
    for (whole k = 0; k < d; k++) {
      const double *place = motion + k * N, *speed = place + f * N;
      way[k] = (j < N ? place[j] : 0) - place[i];
      rate[k] = (j < N ? speed[j] : 0) - speed[i];
      now[k] = c->apart[k * M + m] + way[k];
      both[k] = c->apart[k * M + m] + now[k];
    }
    for (whole k = 0; k < f - d; k++) {
      const double *spin = motion + (f + d + k) * N, other = j < N ? spin[j] : 0;
      turning[turn + k] = R * spin[i] + Q * other;
      spins[turn + k] = spin[i] + other;
    }
    /* the change of the distance since rest, written so that no digits cancel */
    const double distance = sqrt(dot(now, now)), stretch = dot(both, way) / (distance + c->length[m]);
    const double inverse = 1 / distance, n[3] = {now[0] * inverse, now[1] * inverse, now[2] * inverse};
    const double opening = dot(n, rate);
    double along[2][3], about[2][3], lean[2] = {0};
    tangents(c, d, m, n, along, about, lean);
    const Normal normal = normal_of(jkr, c->overlap[m] - stretch, A, F, c->begun[m]);
    const double stiffness = c->B[m] * normal.radius;
    double repulsion = normal.repulsion, limit = repulsion + 2 * (jkr ? 0.75 : 1) * F, dashpot = 0;
    if (c->viscosity != 0 || c->loss >= 0) {
      dashpot = c->loss >= 0 ? sqrt(A * c->mass[m] * normal.radius) * c->loss : normal.radius > 0 ? c->viscosity : 0;
      repulsion -= dashpot * opening;
      if (!c->adheres) limit = fabs(repulsion);
    }
    double across[2], slipped[2] = {0}, spring[2] = {0}, shear[2] = {0}, grown[2] = {0}, square = 0;
    double before[3] = {0}, kept = 1; /* a memory that turns with its contact keeps its length */
    for (whole k = 0; k < d && step > 0; k++) before[k] = memory[k * M + m];
    for (whole a = 0; a < T; a++) slipped[a] = step > 0 ? dot(before, along[a]) : memory[a * M + m];
    if (step > 0) {
      const double left = sqrt(slipped[0] * slipped[0] + slipped[1] * slipped[1]);
      kept = left > 0 ? sqrt(dot(before, before)) / left : 0;
    }
    for (whole a = 0; a < T; a++) {
      across[a] = dot(along[a], rate);
      const double slip_rate = (across[a] - dot(about[a], turning)) * normal.closed;
      grown[a] = c->incremental ? stiffness * slip_rate : slip_rate;
      if (step > 0) slipped[a] = (kept * slipped[a] + step * grown[a]) * normal.closed;
      spring[a] = !c->incremental ? stiffness * slipped[a] : normal.closed != 0 ? slipped[a] : 0;
      shear[a] = spring[a] + c->shear * dashpot * slip_rate;
      square += shear[a] * shear[a];
    }
    const double size = slides ? sqrt(square) : 0;
    limit *= c->friction;
    *changes += (normal.closed != 0) != (c->begun[m] != 0) || (slides && size > limit) ||
                (normal.closed == 0 && (slipped[0] != 0 || slipped[1] != 0));
    if (slides && size > limit && step > 0 && slipped[0] == 0 && slipped[1] == 0) { /* its dashpot alone: 0 in LAMMPS */
      shear[0] = shear[1] = 0;
    } else if (slides && size > limit) { /* slides; in space the slip also turns faster, `network_tangents.swerved` */
      const double follows = (grown[0] * shear[0] + grown[1] * shear[1]) / square;
      for (whole a = 0; a < T; a++) {
        if (d == 3 && limit > 0) grown[a] += (size / limit - 1) * (grown[a] - follows * shear[a]);
        const double left = shear[a] * (limit / size);
        spring[a] = left - (shear[a] - spring[a]);
        shear[a] = left;
        if (step > 0) slipped[a] = stiffness > 0 ? spring[a] / stiffness : 0;
      }
    }
    if (step > 0) {
      const double *memorized = c->incremental ? spring : slipped;
      for (whole k = 0; k < d; k++)
        memory_rate[k * M + m] = memorized[0] * along[0][k] + memorized[1] * along[1][k];
      c->begun[m] = normal.closed != 0;
    } else if (d == 3) {
      const double turns = (across[0] * lean[1] - lean[0] * across[1]) / distance;
      grown[0] += turns * slipped[1];
      grown[1] -= turns * slipped[0];
    }
    for (whole a = 0; a < T && step == 0; a++) memory_rate[a * M + m] = grown[a];
    const double arm = c->shortened[m] * normal.overlap, work = 2 * stiffness * normal.spreading;
    double twist[3];
    for (int k = 0; k < 3; k++) twist[k] = shear[0] * about[0][k] + shear[1] * about[1][k];
    for (whole k = 0; k < d; k++) {
      const double push = shear[0] * along[0][k] + shear[1] * along[1][k] - repulsion * n[k];
      load[k * N + i] += push;
      if (j < N) load[k * N + j] -= push;
    }
    for (whole k = 0; k < f - d; k++) {
      load[(d + k) * N + i] += (R - arm) * twist[turn + k];
      if (j < N) load[(d + k) * N + j] += (Q - arm) * twist[turn + k];
    }
    if (work > 0)
      power += (c->incremental ? opening : -opening) * (spring[0] * spring[0] + spring[1] * spring[1]) / work;
    power -= arm * dot(twist, spins);
  }
  return power;
}

/* Forces and torques (f, N) of pairs, and the rates of their memory (T, M): `network_state.contacts` and `resultants`.
   Returns dW/dt of the ledger, and in `changes` how many contacts slide, have opened or closed, or are open and have a
   memory. With a step the memory is the vector (d, M) of `network_verlet.Carried`; the memory after the step then takes
   the place of its rates, and `begun` is updated. */
double touched(const Contacts *c, const double *motion, const double *memory, double *load, double *memory_rate,
               whole *changes)
{
  if (c->dimension == 2) {
    if (c->jkr) return met(c, motion, memory, load, memory_rate, changes, 2, 1);
    return met(c, motion, memory, load, memory_rate, changes, 2, 0);
  }
  if (c->jkr) return met(c, motion, memory, load, memory_rate, changes, 3, 1);
  return met(c, motion, memory, load, memory_rate, changes, 3, 0);
}

/* Properties of spheres, and of D drives, that a step needs: `network_verlet.Bodies`. The pairs are valid until a
   sphere is farther than `reach` from its `place`. */
typedef struct {
  whole drives;
  double reach;
  const double *mobility, *kept, *shares, *place;
  const whole *component, *moves;
  const unsigned char *acts;
} Bodies;

/* arctan, by its series where that is exact to rounding */
INLINE double turn_of(double x)
{
  const double y = x * x;
  return y < 1e-4 ? x * (1 - y * (1.0 / 3 - y * (1.0 / 5 - y * (1.0 / 7 - y * (1.0 / 9 - y / 11))))) : atan(x);
}

/* Compose rotations with one more, by the rotation vectors h·spin: `network_verlet._composed` */
INLINE void compose(whole N, double h, const double *spin, double *turns)
{
  for (whole i = 0; i < N; i++) {
    const double way[3] = {h * spin[i], h * spin[N + i], h * spin[2 * N + i]}, grows = 1 + dot(way, way) / 12;
    const double a[3] = {grows * way[0], grows * way[1], grows * way[2]};
    const double b[3] = {turns[i], turns[N + i], turns[2 * N + i]}, both = 1 / (1 - dot(a, b) / 4);
    for (int k = 0; k < 3; k++) {
      const int l = (k + 1) % 3, m = (k + 2) % 3;
      turns[k * N + i] = both * (b[k] + a[k] + 0.5 * (a[l] * b[m] - a[m] * b[l]));
    }
  }
}

/* Steps of `network_verlet.stepped` in the motion (2f, N), memory and accelerations of spheres, with `values` (count,
   D, 2) of their drives; `kick` (f, N) is scratch space. Returns the number of steps made, negative if the last one
   went beyond the reach. */
whole verlet(const Contacts *c, const Bodies *b, double *motion, double *memory, double *rates, double *kick,
             const double *values, whole count)
{
  const whole N = c->spheres, d = c->dimension, f = d == 2 ? 3 : 6;
  const double h = c->step;
  double *velocity = motion + f * N, *turns = motion + d * N;
  for (whole n = 1; n <= count; n++, values += 2 * b->drives) {
    double farthest = 0;
    whole changes;
    for (whole k = 0; k < f * N; k++) velocity[k] = kick[k] = velocity[k] + h / 2 * rates[k];
    for (whole k = 0; k < d * N; k++) motion[k] += h * kick[k];
    for (whole i = 0; i < N && d == 2; i++) turns[i] += turn_of(h * kick[d * N + i]);
    if (d == 3) compose(N, h, kick + d * N, turns);
    for (whole q = 0; q < b->drives; q++)
      for (whole i = 0, k = b->component[q] * N; i < N && b->moves[q]; i++)
        if (b->acts[q * N + i]) {
          motion[k + i] = values[2 * q] * b->shares[q * N + i];
          velocity[k + i] = values[2 * q + 1] * b->shares[q * N + i];
        }
    touched(c, motion, memory, rates, memory, &changes);
    for (whole q = 0; q < b->drives; q++)
      for (whole i = 0, k = b->component[q] * N; i < N && !b->moves[q]; i++)
        rates[k + i] += values[2 * q] * b->shares[q * N + i];
    for (whole k = 0; k < f; k++)
      for (whole i = k * N; i < (k + 1) * N; i++) {
        rates[i] *= b->mobility[i];
        velocity[i] = b->kept[i - k * N] * (kick[i] + h / 2 * rates[i]);
      }
    for (whole k = 0; k < d * N; k++) farthest = fmax(farthest, fabs(motion[k] - b->place[k]));
    if (farthest > b->reach) return -n;
  }
  return count;
}

/* Spheres in a row of chain.py; displacements and velocities are in units of chain_motion.py. Without dashpots,
   `dashpot` is NULL. */
typedef struct {
  whole spheres;
  const double *stiffness, *overlap, *load, *mass, *dashpot;
  double length, speed;
} Chain;

/* Waves on the phase torus of K points, real or complex, as in lattice.py. The state of a wave, (6 or 9, K), has the
   rows p, q, φ, their rates, and with `history` the shear of the contacts ahead. */
enum { BONDS = 3, MOST = 128 };
typedef struct {
  whole waves, points, history, incremental, potential;
  const double *shifts, *back; /* matrix to the neighbours ahead (K, 3K), and its transpose */
  double along[BONDS], across[BONDS]; /* components p and q of the directions at rest */
  double A, F, shear, length, overlap_ratio; /* length is 0 if directions are fixed */
  double depth, width, least; /* for JKR, as in network_laws.py and adhesion.py; depth is 0 for DMT */
  double dashpot, softens; /* softens: whether the dashpot goes as the root of the contact radius */
  double mobility[3];
} Torus;

INLINE double root_of(double x) { return sqrt(x); }
INLINE double ratio(double x, double y) { return x / y; }

/* Root of a number whose real part is not negative, as for contacts that stay closed */
INLINE double complex root_of_complex(double complex z)
{
  const double x = creal(z), y = cimag(z), half = sqrt((sqrt(x * x + y * y) + x) / 2);
  return half != 0 ? half + I * (y / (2 * half)) : 0;
}

INLINE double complex ratio_complex(double complex z, double complex w)
{
  const double u = creal(w), v = cimag(w);
  return z * conj(w) / (u * u + v * v);
}

/* Newton's method from the root s of 3s⁴ − 2s = Re x to the root for x, with as many steps as in adhesion.py */
INLINE double root_near(double s, double x) { return s; }
INLINE double complex root_near_complex(double complex s, double complex x)
{
  for (int step = 0; step < 4; step++) {
    const double complex cube = s * s * s;
    s = ratio_complex(9 * cube * s + x, 12 * cube - 2);
  }
  return s;
}

/* This file includes its last part twice, once for each kind of number. */
#define NUMBER double
#define OF(name) name
#include "loops.c"
#undef NUMBER
#undef OF
#define NUMBER double complex
#define OF(name) name##_complex
#include "loops.c"

/* `count` steps of velocity Verlet, as in the case timestep: the slip grows with the speeds of the half step. */
void stepped(const Torus *t, double *state, double *rate, double step, whole count)
{
  const whole speeds = 3 * t->points, memory = 6 * t->points, size = (t->history ? 9 : 6) * t->points;
  torus(t, state, rate);
  for (whole n = 0; n < count; n++) {
    for (whole i = speeds; i < memory; i++) state[i] += step / 2 * rate[i];
    for (whole i = 0; i < speeds; i++) state[i] += step * state[speeds + i];
    if (t->history) {
      torus(t, state, rate);
      for (whole i = memory; i < size; i++) state[i] += step * rate[i];
    }
    torus(t, state, rate);
    for (whole i = speeds; i < memory; i++) state[i] += step / 2 * rate[i];
  }
}

#else

/* rate = the time derivative of a chain */
void OF(chain)(const Chain *c, const NUMBER *state, NUMBER *rate)
{
  const whole n = c->spheres;
  const double scale = c->length / (c->speed * c->speed);
  NUMBER left = 0, behind = 0; /* sphere to the left of a contact, and force of the contact before it */
  for (whole i = 0; i <= n; i++) {
    const NUMBER right = i < n ? state[i] * c->length : 0, depth = left - right + c->overlap[i];
    NUMBER force = creal(depth) > 0 ? depth * OF(root_of)(depth) * c->stiffness[i] : 0;
    if (c->dashpot && creal(depth) > 0) {
      const NUMBER nearing = (i > 0 ? state[n + i - 1] * c->speed : 0) - (i < n ? state[n + i] * c->speed : 0);
      force += c->dashpot[i] * OF(root_of)(OF(root_of)(depth)) * nearing;
    }
    if (i > 0) {
      rate[i - 1] = state[n + i - 1];
      rate[n + i - 1] = (behind - force + c->load[i - 1]) / c->mass[i - 1] * scale;
    }
    left = right;
    behind = force;
  }
}

/* `count` steps of chain_motion.py, whose parts have these half lengths, in states (chains, 2, n) with their rates */
void OF(marched)(const Chain *c, NUMBER *state, NUMBER *rate, whole chains, const double *halves, whole parts, whole count)
{
  const whole n = c->spheres;
  for (NUMBER *u = state, *pull = rate + n; u < state + 2 * n * chains; u += 2 * n, pull += 2 * n) {
    NUMBER *v = u + n;
    for (whole part = 0; part < parts * count; part++) {
      const double half = halves[part % parts];
      for (whole i = 0; i < n; i++) {
        v[i] += half * pull[i];
        u[i] += 2 * half * v[i];
      }
      OF(chain)(c, u, pull - n);
      for (whole i = 0; i < n; i++) v[i] += half * pull[i];
    }
  }
}

/* out = values of K points @ matrix (K, n), four rows at a time */
INLINE void OF(shifted)(whole K, whole n, const NUMBER *values, const double *matrix, NUMBER *restrict out)
{
  whole k = 0;
  for (whole i = 0; i < n; i++) out[i] = 0;
  for (; k + 4 <= K; k += 4) {
    const double *a = matrix + k * n, *b = a + n, *c = b + n, *d = c + n;
    const NUMBER A = values[k], B = values[k + 1], C = values[k + 2], D = values[k + 3];
    for (whole i = 0; i < n; i++) out[i] = out[i] + A * a[i] + B * b[i] + C * c[i] + D * d[i];
  }
  for (; k < K; k++)
    for (whole i = 0; i < n; i++) out[i] += values[k] * matrix[k * n + i];
}

/* n·d, t·d, σ (3, 3K) of the contacts ahead, from p, q, φ (3, K) */
INLINE void OF(deformed)(const Torus *t, const NUMBER *places, NUMBER apart[3][BONDS * MOST])
{
  const whole K = t->points;
  for (int row = 0; row < 3; row++) {
    const double sign = row < 2 ? -1 : 1;
    const NUMBER *here = places + row * K;
    OF(shifted)(K, BONDS * K, here, t->shifts, apart[row]);
    for (int bond = 0; bond < BONDS; bond++)
      for (whole k = 0; k < K; k++) apart[row][bond * K + k] += sign * here[k];
  }
  for (int bond = 0; bond < BONDS; bond++)
    for (whole k = bond * K; k < (bond + 1) * K; k++) {
      const NUMBER p = apart[0][k], q = apart[1][k];
      apart[0][k] = t->along[bond] * p + t->across[bond] * q;
      apart[1][k] = t->along[bond] * q - t->across[bond] * p;
    }
}

/* Stretch of a contact, from n·d and t·d */
INLINE NUMBER OF(stretched)(const Torus *t, NUMBER n, NUMBER s, NUMBER *distance)
{
  const NUMBER ahead = t->length + n, excess = (t->length + ahead) * n + s * s;
  *distance = t->length != 0 ? OF(root_of)(t->length * t->length + excess) : 1;
  return t->length != 0 ? OF(ratio)(excess, *distance + t->length) : n;
}

/* Radius and pull −f_N (M) of JKR contacts */
static void OF(adhered)(const Torus *t, const NUMBER apart[3][BONDS * MOST], NUMBER *radius, NUMBER *pull)
{
  for (whole m = 0; m < BONDS * t->points; m++) {
    NUMBER distance;
    const NUMBER overlap = 1 - OF(stretched)(t, apart[0][m], apart[1][m], &distance);
    const NUMBER place = (creal(overlap) > t->least ? overlap : t->least) / t->depth;
    const double x = creal(place), fourth = 4 * x / 9, first = cbrt(2.0 / 9 + sqrt(4.0 / 81 + fourth * fourth * fourth));
    const double u = first - fourth / first, root = sqrt(u), near = (root + sqrt(4 / (3 * root) - u)) / 2;
    const double cube = near * near * near;
    const NUMBER s = OF(root_near)(near - (3 * cube * near - 2 * near - x) / (12 * cube - 2), place), y = s * s * s;
    radius[m] = t->width * s * s;
    pull[m] = -3 * t->F * (y * y - y);
  }
}

/* rate = the time derivative of a state, `lattice.rhs` */
VECTORS void OF(torus)(const Torus *t, const NUMBER *states, NUMBER *rates)
{
  const whole K = t->points, M = BONDS * K, size = (t->history ? 9 : 6) * K;
  for (whole wave = 0; wave < t->waves; wave++) {
    const NUMBER *state = states + wave * size, *memory = state + 6 * K;
    NUMBER *rate = rates + wave * size;
    NUMBER apart[3][BONDS * MOST], moving[3][BONDS * MOST], pull[3][BONDS * MOST], behind[MOST];
    NUMBER radius[BONDS * MOST], presses[BONDS * MOST];
    OF(deformed)(t, state, apart);
    if (t->depth != 0) OF(adhered)(t, apart, radius, presses);
    if (t->history || t->dashpot != 0)
      OF(deformed)(t, state + 3 * K, moving);
    else
      for (int row = 0; row < 3; row++)
        for (whole m = 0; m < M; m++) moving[row][m] = 0;
#pragma GCC ivdep
    for (whole m = 0; m < M; m++) {
      NUMBER distance;
      const NUMBER n = apart[0][m], s = apart[1][m], free = 1 - OF(stretched)(t, n, s, &distance);
      const NUMBER cosine = t->length != 0 ? OF(ratio)(t->length + n, distance) : 1;
      const NUMBER sine = t->length != 0 ? OF(ratio)(s, distance) : 0;
      const NUMBER overlap = creal(free) > t->least ? free : t->least;
      const NUMBER root = t->depth != 0 ? radius[m] : OF(root_of)(overlap);
      const NUMBER opening = cosine * moving[0][m] + sine * moving[1][m];
      const NUMBER slipping = cosine * moving[1][m] - sine * moving[0][m] - moving[2][m];
      const NUMBER slip = t->history ? memory[m] : cosine * s - sine * n - apart[2][m];
      const NUMBER spring = t->history && t->incremental ? slip : t->shear * root * slip;
      const NUMBER pushed = t->potential && creal(overlap) > 0 ? OF(ratio)(spring * slip, 4 * overlap) : 0;
      const NUMBER resists = t->dashpot * (t->softens != 0 ? OF(root_of)(root) : creal(overlap) > t->least ? 1.0 : 0.0);
      const NUMBER N = (t->depth != 0 ? presses[m] : t->F - t->A * overlap * root - pushed) + resists * opening;
      const NUMBER S = spring + (t->shear != 0 ? resists * slipping : 0);
      pull[0][m] = cosine * N - sine * S;
      pull[1][m] = sine * N + cosine * S;
      pull[2][m] = S * (1 - t->overlap_ratio * overlap);
      moving[2][m] = t->incremental ? t->shear * root * slipping : slipping;
    }
    for (whole k = 0; k < 3 * K; k++) rate[k] = state[3 * K + k];
    if (t->history)
      for (whole m = 0; m < M; m++) rate[6 * K + m] = moving[2][m];
    for (int bond = 0; bond < BONDS; bond++)
      for (whole m = bond * K; m < (bond + 1) * K; m++) {
        const NUMBER n = pull[0][m], s = pull[1][m];
        pull[0][m] = t->along[bond] * n - t->across[bond] * s;
        pull[1][m] = t->across[bond] * n + t->along[bond] * s;
      }
    for (int row = 0; row < 3; row++) {
      NUMBER *force = rate + (3 + row) * K;
      OF(shifted)(M, K, pull[row], t->back, behind);
      for (whole k = 0; k < K; k++) {
        const NUMBER ahead = pull[row][k] + pull[row][K + k] + pull[row][2 * K + k];
        force[k] = t->mobility[row] * (row < 2 ? ahead - behind[k] : ahead + behind[k]);
      }
    }
  }
}

#endif
