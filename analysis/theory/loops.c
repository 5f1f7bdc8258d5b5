/* Loops over numbers and contacts, compiled where there is a compiler (loops.py).

   What each computes stands in Python beside its caller, with NumPy: integrator.py and network_state.py. Here it is
   one pass in place of dozens, with the same formulas. Sums that NumPy takes in another order round otherwise. */

#ifndef NUMBER
#include <complex.h>
#include <math.h>
#include <pthread.h>
#include <stddef.h>

typedef ptrdiff_t whole; /* intp of NumPy */
enum { LANES = 64 }; /* numbers that stay in the nearest cache together */
enum { FEW = 16 };   /* fewer contacts in a row are gathered one by one */
enum { PART = 16384, MOST_THREADS = 64 }; /* numbers of a part */

/* The widest vectors of the processor at hand; without fused products all of them give the same bits */
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define VECTORS __attribute__((target_clones("avx512f", "avx2", "default")))
#define INLINE static inline __attribute__((always_inline))
#else
#define INLINE static inline
#define VECTORS
#endif

/* Work in numbered parts, which threads take as they come. What a part computes does not depend on who takes it. */
typedef struct {
  void (*part)(const void *, whole);
  const void *data;
  whole parts, taken;
} Shared;

static void *take(void *shared)
{
  Shared *s = shared;
  for (whole k; (k = __atomic_fetch_add(&s->taken, 1, __ATOMIC_RELAXED)) < s->parts;) s->part(s->data, k);
  return NULL;
}

/* Threads are made for one call: a process that forks later has none to miss. */
static void share(whole threads, whole parts, void (*part)(const void *, whole), const void *data)
{
  Shared shared = {part, data, parts, 0};
  pthread_t others[MOST_THREADS];
  whole made = 0;
  while (made + 1 < threads && made + 1 < parts && made < MOST_THREADS &&
         !pthread_create(&others[made], NULL, take, &shared))
    made++;
  take(&shared);
  while (made > 0) pthread_join(others[--made], NULL);
}

typedef struct {
  whole n, rows;
  const double *weights, *table;
  whole stride;
  double *out;
} Weighted;

VECTORS static void weighted_part(const void *data, whole part)
{
  const Weighted *w = data;
  const whole last = (part + 1) * PART < w->n ? (part + 1) * PART : w->n;
  for (whole from = part * PART; from < last; from += 8 * LANES) {
    const whole count = last - from < 8 * LANES ? last - from : 8 * LANES;
    double sum[8 * LANES] = {0};
    for (whole r = 0; r < w->rows; r++)
      if (w->weights[r] != 0)
        for (whole i = 0; i < count; i++) sum[i] += w->weights[r] * w->table[r * w->stride + from + i];
    for (whole i = 0; i < count; i++) w->out[from + i] = sum[i];
  }
}

/* out = sum of weights[r] * table[r], for rows of n numbers that are `stride` apart; a weight of 0 takes no time. */
void weighted(whole threads, whole n, whole rows, const double *weights, const double *table, whole stride, double *out)
{
  const Weighted data = {n, rows, weights, table, stride, out};
  share(threads, (n + PART - 1) / PART, weighted_part, &data);
}

typedef struct {
  whole n, rows;
  const double *weights, *slopes, *begin, *after, *atol;
  whole each;
  double rtol, *squares;
} Errors;

VECTORS static void errors_part(const void *data, whole part)
{
  const Errors *e = data;
  const whole last = (part + 1) * PART < e->n ? (part + 1) * PART : e->n;
  double total[2][LANES] = {{0}};
  for (whole from = part * PART; from < last; from += LANES) {
    const whole count = last - from < LANES ? last - from : LANES;
    double scale[LANES], sum[2][LANES] = {{0}};
    for (whole i = 0; i < count; i++) {
      const double a = fabs(e->begin[from + i]), b = fabs(e->after[from + i]);
      scale[i] = (e->each ? e->atol[from + i] : e->atol[0]) + e->rtol * (a > b ? a : b);
    }
    for (whole r = 0; r < e->rows; r++) {
      const double one = e->weights[r], two = e->weights[e->rows + r], *slope = e->slopes + r * e->n + from;
      if (one != 0 || two != 0)
        for (whole i = 0; i < count; i++) {
          sum[0][i] += one * slope[i];
          sum[1][i] += two * slope[i];
        }
    }
    for (whole i = 0; i < count; i++) {
      const double one = sum[0][i] / scale[i], two = sum[1][i] / scale[i];
      total[0][i] += one * one;
      total[1][i] += two * two;
    }
  }
  double *squares = e->squares + 2 * part;
  squares[0] = squares[1] = 0;
  for (whole i = 0; i < LANES; i++) {
    squares[0] += total[0][i];
    squares[1] += total[1][i];
  }
}

/* squares[part][e] = sum over the numbers of a part of
   (Σ_r weights[e][r] slopes[r] / (atol + rtol max(|begin|, |after|)))², e = 0, 1; with a tolerance for each number, or
   one for all. */
void errors(whole threads, whole n, whole rows, const double *weights, const double *slopes, const double *begin,
            const double *after, const double *atol, whole each, double rtol, double *squares)
{
  const Errors data = {n, rows, weights, slopes, begin, after, atol, each, rtol, squares};
  share(threads, (n + PART - 1) / PART, errors_part, &data);
}

/* Pairs of `network_state.Pairs` in the plane. They come by blocks of `width` first spheres: of each those that stay in
   the block, then those that leave it; at last those on walls, which are at rest. `starts` says where each begins.

   Of numbers that are the same for all pairs, `same`, there are LANES. `outside` (3, M) holds the loads on second
   spheres of other blocks, until all blocks are done. */
enum { X, Y, LENGTH, OVERLAP, HERTZ, SHEAR, ADHESION, NUMBERS };
enum { PLACE_X, PLACE_Y, SPEED_X, SPEED_Y, SPIN, RADIUS, ENDS };
typedef struct {
  whole spheres, pairs, blocks, width;
  double friction;
  const whole *starts;
  const int *first, *second;
  const double *numbers[NUMBERS];
  whole same[NUMBERS];
  const double *radius;
  double *outside;
} Pairs;

typedef struct {
  const Pairs *pairs;
  const double *motion, *slip;
  double *load, *slip_rate, *sums;
} Acting;

typedef enum { INSIDE, OUTSIDE, WALL } Where;

/* Forces, torques and the rates of slips of some pairs; forces on second spheres outside are left in `outside`. */
INLINE void acted(const Acting *a, whole from, whole end, Where where, double sums[4][LANES])
{
  const Pairs *p = a->pairs;
  const whole N = p->spheres;
  const double mu = p->friction, shortened = where == WALL ? 0 : 0.5;
  const double *rows[ENDS] = {a->motion, a->motion + N, a->motion + 3 * N, a->motion + 4 * N, a->motion + 5 * N, p->radius};
  for (whole count; from < end; from += count) {
    const int *first = p->first + from, *second = p->second + from, i = first[0], j = second[0];
    const whole left = end - from;
    double gathered[2][ENDS][FEW], push[4][LANES];
    const double *here[ENDS], *there[ENDS], *number[NUMBERS];
    /* in a crystal the contacts of spheres i, i + 1, … with j, j + 1, … follow each other */
    for (count = 1; count < left && count < LANES && first[count] == i + count && second[count] == j + count;) count++;
    const int run = where != WALL && (count >= FEW || count == left);
    if (!run) count = left < FEW ? left : FEW;
    for (int k = 0; k < ENDS; k++) {
      here[k] = run ? rows[k] + i : gathered[0][k];
      there[k] = run ? rows[k] + j : gathered[1][k];
    }
    if (!run)
      for (whole c = 0; c < count; c++)
        for (int k = 0; k < ENDS; k++) {
          gathered[0][k][c] = rows[k][first[c]];
          gathered[1][k][c] = where == WALL ? 0 : rows[k][second[c]];
        }
    for (int k = 0; k < NUMBERS; k++) number[k] = p->numbers[k] + (p->same[k] ? 0 : from);
    const double *ax = number[X], *ay = number[Y], *length = number[LENGTH], *gap = number[OVERLAP];
    const double *A = number[HERTZ], *B = number[SHEAR], *F = number[ADHESION], *slid = a->slip + from;
    const double *R = here[RADIUS], *Q = there[RADIUS];
    double *rate = a->slip_rate + from;
#pragma GCC ivdep
    for (whole c = 0; c < count; c++) {
      const double dx = there[PLACE_X][c] - here[PLACE_X][c], dy = there[PLACE_Y][c] - here[PLACE_Y][c];
      const double rx = there[SPEED_X][c] - here[SPEED_X][c], ry = there[SPEED_Y][c] - here[SPEED_Y][c];
      const double nowx = ax[c] + dx, nowy = ay[c] + dy, distance = sqrt(nowx * nowx + nowy * nowy);
      /* one division for the normal and for the stretch */
      const double both = distance + length[c], inverse = 1 / (distance * both), unit = both * inverse;
      const double nx = nowx * unit, ny = nowy * unit;
      const double stretch = ((ax[c] + nowx) * dx + (ay[c] + nowy) * dy) * (distance * inverse);
      const double depth = gap[c] - stretch, closed = depth > 0 ? 1.0 : 0.0, overlap = depth * closed;
      const double root = sqrt(overlap), P = A[c] * overlap * root - F[c] * closed;
      const double S = B[c] * root * slid[c], arm = shortened * overlap, energy = S * slid[c];
      push[0][c] = -ny * S - P * nx;
      push[1][c] = nx * S - P * ny;
      push[2][c] = (R[c] - arm) * S;
      push[3][c] = (Q[c] - arm) * S;
      const double here_spin = here[SPIN][c], there_spin = there[SPIN][c];
      rate[c] = (nx * ry - ny * rx - R[c] * here_spin - Q[c] * there_spin) * closed;
      /* an open contact has no energy, and something to divide by */
      sums[0][c] -= (nx * rx + ny * ry) * energy / (4 * overlap + (1 - closed)) + arm * S * (here_spin + there_spin);
      sums[1][c] += (0.4 * A[c] * overlap * root - F[c]) * overlap;
      sums[2][c] += energy / 2;
      const double open = slid[c] != 0 ? 1 - closed : 0.0;
      sums[3][c] += open + (fabs(S) > mu * (P + 2 * F[c] * closed) ? 1.0 : 0.0);
    }
    for (int k = 0; k < 3; k++) {
      const double *mine = push[k], *others = push[k < 2 ? k : 3], sign = k < 2 ? -1 : 1;
      double *load = a->load + k * N, *outside = p->outside + k * p->pairs + from;
      if (run)
        for (whole c = 0; c < count; c++) load[i + c] += mine[c];
      else
        for (whole c = 0; c < count; c++) load[first[c]] += mine[c];
      if (where == OUTSIDE)
        for (whole c = 0; c < count; c++) outside[c] = sign * others[c];
      else if (run)
        for (whole c = 0; c < count; c++) load[j + c] += sign * others[c];
      else if (where == INSIDE)
        for (whole c = 0; c < count; c++) load[second[c]] += sign * others[c];
    }
  }
}

/* One block of spheres, or the walls behind the last */
VECTORS static void block(const void *data, whole number)
{
  const Acting *a = data;
  const Pairs *p = a->pairs;
  const whole N = p->spheres, from = number * p->width, end = from + p->width < N ? from + p->width : N;
  const whole *starts = p->starts + 2 * number;
  double sums[4][LANES] = {{0}};
  if (number < p->blocks) {
    for (int k = 0; k < 3; k++)
      for (whole i = from; i < end; i++) a->load[k * N + i] = 0;
    acted(a, starts[0], starts[1], INSIDE, sums);
    acted(a, starts[1], starts[2], OUTSIDE, sums);
  } else
    acted(a, starts[0], p->pairs, WALL, sums);
  for (int k = 0; k < 4; k++) {
    a->sums[4 * number + k] = 0;
    for (whole c = 0; c < LANES; c++) a->sums[4 * number + k] += sums[k][c];
  }
}

/* Forces and torques (3, N) of pairs with the secant law, without dashpots, and the rates of slips.

   motion: (6, N). slip, slip_rate: (M). sums (blocks + 1, 4): dW/dt of the ledger, the energies of normal and of shear
   forces, and how many contacts are open and have a slip, or are beyond the limit of friction, where the forces are
   others. */
void plane(whole threads, const Pairs *p, const double *motion, const double *slip, double *load, double *slip_rate,
           double *sums)
{
  const Acting data = {p, motion, slip, load, slip_rate, sums};
  share(threads, p->blocks, block, &data);
  for (whole number = 0; number < p->blocks; number++)
    for (int k = 0; k < 3; k++)
      for (whole c = p->starts[2 * number + 1]; c < p->starts[2 * number + 2]; c++)
        load[k * p->spheres + p->second[c]] += p->outside[k * p->pairs + c];
  block(&data, p->blocks);
}

/* Spheres in a row of chain.py without dashpots: displacements and velocities in units of chain_motion.py. */
typedef struct {
  whole spheres;
  const double *stiffness, *overlap, *load, *mass;
  double length, scale;
} Chain;

void chain(const Chain *c, const double *state, double *rate)
{
  const whole n = c->spheres;
  double left = 0, behind = 0; /* the sphere to the left of a contact, and the force of that before it */
  for (whole i = 0; i <= n; i++) {
    const double right = i < n ? state[i] * c->length : 0, depth = left - right + c->overlap[i];
    const double force = depth > 0 ? depth * sqrt(depth) * c->stiffness[i] : 0;
    if (i > 0) {
      rate[i - 1] = state[n + i - 1];
      rate[n + i - 1] = (behind - force + c->load[i - 1]) / c->mass[i - 1] * c->scale;
    }
    left = right;
    behind = force;
  }
}

/* Steps of chain_motion.py, whose parts have these halves, of chains that begin with their rates: (chains, 2, n) each */
void marched(const Chain *c, double *state, double *rate, whole chains, const double *halves, whole parts, whole count)
{
  const whole n = c->spheres;
  for (double *u = state, *pull = rate + n; u < state + 2 * n * chains; u += 2 * n, pull += 2 * n) {
    double *v = u + n;
    for (whole part = 0; part < parts * count; part++) {
      const double half = halves[part % parts];
      for (whole i = 0; i < n; i++) {
        v[i] += half * pull[i];
        u[i] += 2 * half * v[i];
      }
      chain(c, u, pull - n);
      for (whole i = 0; i < n; i++) v[i] += half * pull[i];
    }
  }
}

/* Waves on the phase torus of K points, real or complex, as of lattice.py: a state has the rows p, q, φ, their rates,
   with `history` the shear of the contacts ahead, and with `works` the work of the shear law as of energy.py, (6 to 10,
   K) a wave. */
enum { BONDS = 3, MOST = 128 };
typedef struct {
  whole waves, points, history, incremental, potential, works;
  const double *shifts, *back; /* to the neighbours ahead (K, 3K), and its transpose */
  double along[BONDS], across[BONDS]; /* p and q of the directions at rest */
  double A, F, shear, length, overlap_ratio; /* a length of 0: directions are fixed */
  double dashpot, softens; /* and whether a dashpot goes as the root of the contact radius */
  double mobility[3];
  double sign; /* of the work */
} Torus;

INLINE double root_of(double x) { return sqrt(x); }
INLINE double ratio(double x, double y) { return x / y; }

/* Of a number whose real part is not negative, as those of contacts that stay closed */
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

/* This file reads its last part twice, once for each kind of number. */
#define NUMBER double
#define OF(name) name
#include "loops.c"
#undef NUMBER
#undef OF
#define NUMBER double complex
#define OF(name) name##_complex
#include "loops.c"

/* The slopes first to last of a step of a Runge-Kutta method: each of the sum of the rows before it, with the weights of
   its row of 17. stack: the state, then the slopes, n numbers a row; trial: where the last was taken. */
void stages(whole n, whole first, whole last, whole width, const double *weights, double *stack, double *trial,
            void (*slope)(const void *, const double *, double *), const void *data)
{
  for (whole row = first; row <= last; row++) {
    weighted(1, n, row + 1, weights + row * width, stack, n, trial);
    slope(data, trial, stack + (row + 1) * n);
  }
}

/* `count` steps of velocity Verlet, as of timestep.py: the slip grows with the speeds of half a step. */
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

/* out = values of K points @ matrix (K, n) */
INLINE void OF(shifted)(whole K, whole n, const NUMBER *values, const double *matrix, NUMBER *out)
{
  for (whole i = 0; i < n; i++) out[i] = 0;
  for (whole k = 0; k < K; k++)
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

/* rate = the time derivative of a state, `lattice.rhs` */
VECTORS void OF(torus)(const Torus *t, const NUMBER *states, NUMBER *rates)
{
  const whole K = t->points, M = BONDS * K, last = (t->history ? 9 : 6) * K, size = last + (t->works ? K : 0);
  for (whole wave = 0; wave < t->waves; wave++) {
    const NUMBER *state = states + wave * size, *memory = state + 6 * K;
    NUMBER *rate = rates + wave * size;
    NUMBER apart[3][BONDS * MOST], moving[3][BONDS * MOST], pull[3][BONDS * MOST], behind[MOST], power[BONDS * MOST];
    OF(deformed)(t, state, apart);
    if (t->history || t->works || t->dashpot != 0)
      OF(deformed)(t, state + 3 * K, moving);
    else
      for (int row = 0; row < 3; row++)
        for (whole m = 0; m < M; m++) moving[row][m] = 0;
#pragma GCC ivdep
    for (whole m = 0; m < M; m++) {
      const NUMBER n = apart[0][m], s = apart[1][m], ahead = t->length + n, excess = (t->length + ahead) * n + s * s;
      const NUMBER distance = t->length != 0 ? OF(root_of)(t->length * t->length + excess) : 1;
      const NUMBER cosine = t->length != 0 ? OF(ratio)(ahead, distance) : 1;
      const NUMBER sine = t->length != 0 ? OF(ratio)(s, distance) : 0;
      const NUMBER stretch = t->length != 0 ? OF(ratio)(excess, distance + t->length) : n;
      const NUMBER overlap = creal(stretch) < 1 ? 1 - stretch : 0, root = OF(root_of)(overlap);
      const NUMBER opening = cosine * moving[0][m] + sine * moving[1][m];
      const NUMBER slipping = cosine * moving[1][m] - sine * moving[0][m] - moving[2][m];
      const NUMBER slip = t->history ? memory[m] : cosine * s - sine * n - apart[2][m];
      const NUMBER spring = t->history && t->incremental ? slip : t->shear * root * slip;
      const NUMBER pushed = t->potential && creal(overlap) > 0 ? OF(ratio)(spring * slip, 4 * overlap) : 0;
      const NUMBER resists = t->dashpot * (t->softens != 0 ? OF(root_of)(root) : creal(overlap) > 0 ? 1.0 : 0.0);
      const NUMBER N = t->F - t->A * overlap * root - pushed + resists * opening;
      const NUMBER S = spring + (t->shear != 0 ? resists * slipping : 0);
      const NUMBER sheared = t->history && t->incremental ? OF(ratio)(slip, t->shear * root) : slip;
      const NUMBER growth = creal(overlap) > 0 ? OF(ratio)(0.5, root) : 0;
      power[m] = -0.5 * t->sign * t->shear * growth * sheared * sheared * moving[0][m];
      pull[0][m] = cosine * N - sine * S;
      pull[1][m] = sine * N + cosine * S;
      pull[2][m] = S * (1 - t->overlap_ratio * overlap);
      moving[2][m] = t->incremental ? t->shear * root * slipping : slipping;
    }
    for (whole k = 0; k < 3 * K; k++) rate[k] = state[3 * K + k];
    if (t->history)
      for (whole m = 0; m < M; m++) rate[6 * K + m] = moving[2][m];
    if (t->works)
      for (whole k = 0; k < K; k++) rate[last + k] = power[k] + power[K + k] + power[2 * K + k];
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
