/* Loops over numbers and contacts, compiled where there is a compiler (loops.py).

   What each computes stands in Python beside its caller, with NumPy: integrator.py and network_state.py. Here it is
   one pass in place of dozens, with the same formulas. Sums that NumPy takes in another order round otherwise. */

#ifndef NUMBER
#include <complex.h>
#include <math.h>
#include <pthread.h>
#include <sched.h>
#include <stddef.h>

typedef ptrdiff_t whole; /* intp of NumPy */
enum { LANES = 64 }; /* numbers that stay in the nearest cache together */
enum { FEW = 16 };   /* fewer contacts in a row are gathered one by one */
enum { PART = 16384, CHUNK = 256, MOST_ROWS = 17, MOST_THREADS = 64 }; /* numbers of a part, rows of a step */

/* The widest vectors of the processor at hand; without fused products all of them give the same bits. PLAIN has none:
   a test compiles it in a third of the time. */
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(PLAIN)
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

/* out = base + sum of weights[r] * table[r], for rows of numbers that are `stride` apart; no base is 0, and a weight of 0
   takes no time. */
INLINE void summed(whole count, whole rows, const double *weights, const double *table, whole stride, const double *base,
                   double *restrict out)
{
  const double *row[MOST_ROWS + 3];
  double weight[MOST_ROWS + 3];
  whole used = 0;
  for (whole each = 0; each < rows; each++)
    if (weights[each] != 0) {
      weight[used] = weights[each];
      row[used++] = table + each * stride;
    }
  if (!base && used == 0)
    for (whole i = 0; i < count; i++) out[i] = 0;
  for (whole r = 0; r < used; r += 4) {
    const double *from = r > 0 ? out : base, *a = row[r], *b = row[r + 1], *c = row[r + 2], *d = row[r + 3];
    const double A = weight[r], B = weight[r + 1], C = weight[r + 2], D = weight[r + 3];
#define SUM(terms)                                                            \
  if (from)                                                                    \
    for (whole i = 0; i < count; i++) out[i] = from[i] + terms;                \
  else                                                                         \
    for (whole i = 0; i < count; i++) out[i] = terms
    if (used - r == 1) {
      SUM(A * a[i]);
    } else if (used - r == 2) {
      SUM(A * a[i] + B * b[i]);
    } else if (used - r == 3) {
      SUM(A * a[i] + B * b[i] + C * c[i]);
    } else {
      SUM(A * a[i] + B * b[i] + C * c[i] + D * d[i]);
    }
#undef SUM
  }
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
  for (whole from = part * PART; from < last; from += CHUNK)
    summed(last - from < CHUNK ? last - from : CHUNK, w->rows, w->weights, w->table + from, w->stride, NULL, w->out + from);
}

/* The sums of n numbers of up to MOST_ROWS rows */
void weighted(whole threads, whole n, whole rows, const double *weights, const double *table, whole stride, double *out)
{
  const Weighted data = {n, rows, weights, table, stride, out};
  share(threads, (n + PART - 1) / PART, weighted_part, &data);
}

/* Tolerances of a step: one for each number, or one for all */
typedef struct {
  const double *begin, *after, *atol;
  whole each;
  double rtol;
} Tolerance;

/* total[e] += (Σ_r weights[e][r] slopes[r] / (atol + rtol max(|begin|, |after|)))², e = 0, 1, of the numbers from `at`;
   the slopes of the first are at `slopes`. */
INLINE void erred(const Tolerance *e, whole at, whole number, whole rows, const double *weights, const double *slopes,
                  whole stride, double total[2][LANES])
{
  for (whole done = 0; done < number; done += LANES) {
    const whole count = number - done < LANES ? number - done : LANES, from = at + done;
    double sum[2][LANES];
    for (int k = 0; k < 2; k++) summed(count, rows, weights + k * rows, slopes + done, stride, NULL, sum[k]);
    for (whole i = 0; i < count; i++) {
      const double a = fabs(e->begin[from + i]), b = fabs(e->after[from + i]);
      const double scale = (e->each ? e->atol[from + i] : e->atol[0]) + e->rtol * (a > b ? a : b);
      const double one = sum[0][i] / scale, two = sum[1][i] / scale;
      total[0][i] += one * one;
      total[1][i] += two * two;
    }
  }
}

INLINE void folded(double total[2][LANES], double *squares)
{
  squares[0] = squares[1] = 0;
  for (whole i = 0; i < LANES; i++) {
    squares[0] += total[0][i];
    squares[1] += total[1][i];
  }
}

typedef struct {
  whole n, rows;
  const double *weights, *slopes;
  Tolerance tolerance;
  double *squares;
} Errors;

VECTORS static void errors_part(const void *data, whole part)
{
  const Errors *e = data;
  const whole from = part * PART, count = from + PART < e->n ? PART : e->n - from;
  double total[2][LANES] = {{0}};
  erred(&e->tolerance, from, count, e->rows, e->weights, e->slopes + from, e->n, total);
  folded(total, e->squares + 2 * part);
}

/* squares[part][e] = the squares above of the numbers of a part */
void errors(whole threads, whole n, whole rows, const double *weights, const double *slopes, const Tolerance *tolerance,
            double *squares)
{
  const Errors data = {n, rows, weights, slopes, *tolerance, squares};
  share(threads, (n + PART - 1) / PART, errors_part, &data);
}

/* Pairs of `network_state.Pairs` in the plane. They come by blocks of `width` first spheres, and of a block by those of
   the second spheres: a bundle is pairs from one block to another, to itself, or to walls, which are at rest. `own` says
   which bundles are of the first spheres of each block, and `met`, from `others` on, which others meet the block.

   Of numbers that are the same for all pairs, `same`, there are LANES. `outside` (3, M) holds the loads on second
   spheres of other blocks, until these take them, and `done` how many tasks each block has done. */
enum { X, Y, LENGTH, OVERLAP, HERTZ, SHEAR, ADHESION, NUMBERS };
enum { PLACE_X, PLACE_Y, SPEED_X, SPEED_Y, SPIN, RADIUS, ENDS };
typedef struct {
  whole first, second, from, end;
} Bundle;
typedef struct {
  whole spheres, pairs, blocks, width;
  double friction;
  const Bundle *bundles;
  const whole *own, *others, *met;
  const int *first, *second, *run;
  const double *numbers[NUMBERS];
  whole same[NUMBERS];
  const double *radius;
  double *outside;
  int *done;
} Pairs;

/* Each block has tasks in turn, and takes the next when its neighbours have done as many: an odd task needs those that
   its own pairs lead to, an even one those whose pairs meet it. A thread goes from block to block, and after each goes
   back as far as blocks have become ready, so that a step of many stages reads its numbers from memory once.

   What a task computes does not depend on who does it, nor when. */
enum { BUSY = 1 << 30 };
typedef struct {
  const Pairs *pairs;
  int tasks, *done; /* of each block, with BUSY while the next is under way */
  void (*task)(const void *, whole, whole);
  const void *data;
  whole threads, finished;
} Sweep;

static int advanced(Sweep *s, whole block)
{
  const Pairs *p = s->pairs;
  int done = __atomic_load_n(s->done + block, __ATOMIC_ACQUIRE);
  if (done >= s->tasks) return 0; /* or BUSY */
  const whole *list = done % 2 ? p->own : p->others;
  for (whole k = list[block]; k < list[block + 1]; k++) {
    const whole other = done % 2 ? p->bundles[k].second : p->bundles[p->met[k]].first;
    if (other < p->blocks && (__atomic_load_n(s->done + other, __ATOMIC_ACQUIRE) & ~BUSY) < done) return 0;
  }
  if (!__atomic_compare_exchange_n(s->done + block, &done, done | BUSY, 0, __ATOMIC_ACQUIRE, __ATOMIC_RELAXED)) return 0;
  s->task(s->data, block, done);
  __atomic_store_n(s->done + block, done + 1, __ATOMIC_RELEASE);
  if (done + 1 == s->tasks) __atomic_fetch_add(&s->finished, 1, __ATOMIC_RELEASE);
  return 1;
}

static void swept(const void *data, whole part)
{
  Sweep *s = (Sweep *)data;
  const whole blocks = s->pairs->blocks;
  whole idle = 0;
  for (whole at = part * blocks / s->threads; __atomic_load_n(&s->finished, __ATOMIC_ACQUIRE) < blocks; at++) {
    whole back = 0, tasks;
    do
      for (tasks = 0; advanced(s, (at + blocks - back) % blocks); tasks++) idle = 0;
    while (tasks > 0 && ++back < blocks);
    if (++idle > blocks) idle = sched_yield();
  }
}

static void sweep(whole threads, const Pairs *p, int tasks, void (*task)(const void *, whole, whole), const void *data)
{
  Sweep s = {p, tasks, p->done, task, data, threads, 0};
  for (whole block = 0; block < p->blocks; block++) s.done[block] = 0;
  share(threads, threads, swept, &s);
}

typedef struct {
  const Pairs *pairs;
  const double *motion, *slip;
  double *load, *slip_rate, *sums;
} Acting;

typedef enum { INSIDE, OUTSIDE, WALL } Where;

/* Forces, torques and the rates of slips of some pairs; forces on second spheres outside are left in `outside`. */
INLINE void acted(const Acting *a, whole from, whole end, Where where, int energies, double sums[4][LANES])
{
  const Pairs *p = a->pairs;
  const whole N = p->spheres;
  const double mu = p->friction, shortened = where == WALL ? 0 : 0.5;
  const double *rows[ENDS] = {a->motion, a->motion + N, a->motion + 3 * N, a->motion + 4 * N, a->motion + 5 * N, p->radius};
  for (whole count; from < end; from += count) {
    const int *first = p->first + from, *second = p->second + from, i = first[0], j = second[0];
    const whole left = end - from, along = p->run[from] < LANES ? p->run[from] : LANES;
    double gathered[2][ENDS][FEW], push[4][LANES];
    const double *here[ENDS], *there[ENDS], *number[NUMBERS];
    /* in a crystal the contacts of spheres i, i + 1, … with j, j + 1, … follow each other */
    count = along < left ? along : left;
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
      if (energies) {
        sums[1][c] += (0.4 * A[c] * overlap * root - F[c]) * overlap;
        sums[2][c] += energy / 2;
      }
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

/* Loads on the spheres of a block by its own pairs */
INLINE void pressed(const Acting *a, whole block, int energies)
{
  const Pairs *p = a->pairs;
  const whole N = p->spheres, from = block * p->width, end = from + p->width < N ? from + p->width : N;
  double sums[4][LANES] = {{0}};
  for (int k = 0; k < 3; k++)
    for (whole i = from; i < end; i++) a->load[k * N + i] = 0;
  for (const Bundle *b = p->bundles + p->own[block]; b < p->bundles + p->own[block + 1]; b++) {
    if (b->second == block)
      acted(a, b->from, b->end, INSIDE, energies, sums);
    else if (b->second < p->blocks)
      acted(a, b->from, b->end, OUTSIDE, energies, sums);
    else
      acted(a, b->from, b->end, WALL, energies, sums);
  }
  for (int k = 0; k < 4; k++) {
    a->sums[4 * block + k] = 0;
    for (whole c = 0; c < LANES; c++) a->sums[4 * block + k] += sums[k][c];
  }
}

/* Loads on the spheres of a block by the pairs that meet it */
INLINE void received(const Acting *a, whole block)
{
  const Pairs *p = a->pairs;
  for (whole met = p->others[block]; met < p->others[block + 1]; met++) {
    const Bundle *b = p->bundles + p->met[met];
    for (whole from = b->from, count; from < b->end; from += count) {
      count = b->end - from < p->run[from] ? b->end - from : p->run[from];
      for (int k = 0; k < 3; k++) {
        double *restrict load = a->load + k * p->spheres + p->second[from];
        const double *outside = p->outside + k * p->pairs + from;
        for (whole c = 0; c < count; c++) load[c] += outside[c];
      }
    }
  }
}

VECTORS static void evaluated(const void *data, whole block, whole task)
{
  if (task == 1) pressed(data, block, 1);
  if (task == 2) received(data, block);
}

/* Forces and torques (3, N) of pairs with the secant law, without dashpots, and the rates of slips.

   motion: (6, N). slip, slip_rate: (M). sums (blocks, 4): dW/dt of the ledger, the energies of normal and of shear
   forces, and how many contacts are open and have a slip, or are beyond the limit of friction, where the forces are
   others. */
void plane(whole threads, const Pairs *p, const double *motion, const double *slip, double *load, double *slip_rate,
           double *sums)
{
  const Acting data = {p, motion, slip, load, slip_rate, sums};
  sweep(threads, p, 3, evaluated, &data);
}

/* The stages first to last of a Runge-Kutta step of spheres, as `stages` below. A number of a state is a place, a
   speed, or a slip: the slope of a place is a speed, so that the sum of the slopes of places is a sum of speeds' slopes
   with other weights, `places`, and rows of the stack have none of places. Begins where `renewed` ended if not NULL. */
typedef struct {
  const Pairs *pairs;
  whole first, last, n;
  const double *weights, *places, *mobility, *drag;
  double *stack, *trial;
  const double *renewed;
  Tolerance tolerance;
  const double *errors, *errors_of_places;
  double *sums, *squares;
} Stages;

INLINE whole size_of(const Pairs *p, whole block)
{
  const whole left = p->spheres - block * p->width;
  return left < p->width ? left : p->width;
}

/* The state where a stage is taken */
INLINE void tried(const Stages *s, whole block, whole row)
{
  const Pairs *p = s->pairs;
  const whole N = p->spheres, first = block * p->width, size = size_of(p, block);
  const double *weights = s->weights + row * MOST_ROWS, *places = s->places + row * MOST_ROWS;
  for (int k = 0; k < 3; k++)
    for (whole done = 0; done < size; done += CHUNK) {
      const whole count = size - done < CHUNK ? size - done : CHUNK, x = k * N + first + done, v = x + 3 * N;
      summed(count, row + 1, weights, s->stack + v, s->n, NULL, s->trial + v);
      summed(count, row + 1, places, s->stack + v, s->n, s->stack + x, s->trial + x);
    }
  for (const Bundle *b = p->bundles + p->own[block]; b < p->bundles + p->own[block + 1]; b++)
    for (whole from = b->from; from < b->end; from += CHUNK)
      summed(b->end - from < CHUNK ? b->end - from : CHUNK, row + 1, weights, s->stack + 6 * N + from, s->n,
             NULL, s->trial + 6 * N + from);
}

/* The state and the slope of the end of the last step become those of the begin */
INLINE void renewed(const Stages *s, whole from, whole count, whole slopes)
{
  double *begin = s->stack + from, *slope = begin + s->n, *ended = begin + (s->last + 1) * s->n;
  for (whole i = 0; i < count; i++) begin[i] = s->renewed[from + i];
  if (slopes)
    for (whole i = 0; i < count; i++) slope[i] = ended[i];
}

VECTORS static void staged(const void *data, whole block, whole task)
{
  const Stages *s = data;
  const Pairs *p = s->pairs;
  const whole N = p->spheres, n = s->n, row = s->first + (task - 1) / 2, first = block * p->width, size = size_of(p, block);
  const Bundle *own = p->bundles + p->own[block], *end = p->bundles + p->own[block + 1];
  if (task == 0) {
    if (s->renewed) {
      for (int k = 0; k < 6; k++) renewed(s, k * N + first, size, k >= 3);
      for (const Bundle *b = own; b < end; b++) renewed(s, 6 * N + b->from, b->end - b->from, 1);
    }
    tried(s, block, s->first);
    return;
  }
  double *slope = s->stack + (row + 1) * n, *load = slope + 3 * N;
  const Acting acting = {p, s->trial, s->trial + 6 * N, load, slope + 6 * N, s->sums + 4 * p->blocks * (row - s->first)};
  if (task % 2) {
    pressed(&acting, block, 0);
    return;
  }
  received(&acting, block);
  for (int k = 0; k < 3; k++)
    for (whole i = k * N + first; i < k * N + first + size; i++) {
      load[i] *= s->mobility[i];
      if (s->drag) load[i] -= s->drag[i - k * N] * s->trial[3 * N + i];
    }
  if (row < s->last)
    tried(s, block, row + 1);
  else if (s->squares) {
    double total[2][LANES] = {{0}};
    for (int k = 0; k < 3; k++) {
      const whole x = k * N + first, v = x + 3 * N;
      erred(&s->tolerance, x, size, s->last + 2, s->errors_of_places, s->stack + v, n, total);
      erred(&s->tolerance, v, size, s->last + 1, s->errors, s->stack + n + v, n, total);
    }
    for (const Bundle *b = own; b < end; b++)
      erred(&s->tolerance, 6 * N + b->from, b->end - b->from, s->last + 1, s->errors, s->stack + n + 6 * N + b->from, n, total);
    folded(total, s->squares + 2 * block);
  }
}

void plane_stages(whole threads, const Stages *s)
{
  sweep(threads, s->pairs, 1 + 2 * (int)(s->last - s->first + 1), staged, s);
}

/* Pairs of `network_state.Pairs` with any of their laws, in the plane or in space: of d components, and T = d − 1
   tangents. `loss` is √5 ζ of a restitution, negative without one. */
typedef struct {
  whole spheres, pairs, dimension, jkr, incremental, shear, adheres;
  double friction, viscosity, loss;
  const whole *first, *second;
  const double *apart, *length, *overlap, *radii, *shortened, *mass, *A, *B, *F, *frame;
  const unsigned char *begun;
} Contacts;

INLINE double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* The normal force of a contact: `network_laws.py` */
typedef struct {
  double closed, overlap, radius, repulsion, spreading;
} Normal;

INLINE Normal normal_of(const Contacts *c, double depth, double A, double F, int begun)
{
  if (!c->jkr) {
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

/* Tangents along[a] of a normal, about[a] = n × along[a], and how these lean: `network_tangents.py` */
INLINE void tangents(const Contacts *c, whole m, const double *n, double along[2][3], double about[2][3], double *lean)
{
  const double plane[2][2][3] = {{{-n[1], n[0], 0}}, {{0, 0, 1}}};
  for (int a = 0; a < 2; a++)
    for (int k = 0; k < 3; k++) {
      along[a][k] = plane[0][a][k];
      about[a][k] = plane[1][a][k];
    }
  if (c->dimension == 2) return;
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

/* Forces and torques (f, N) of pairs, and the rates of their memory (T, M): `network_state.contacts` and `resultants`.
   Returns dW/dt of the ledger. */
double touched(const Contacts *c, const double *motion, const double *memory, double *load, double *memory_rate)
{
  const whole N = c->spheres, M = c->pairs, d = c->dimension, T = d - 1, f = d == 2 ? 3 : 6;
  const whole turn = d == 2 ? 2 : 0; /* the first of the turns about x, y and z */
  double power = 0;
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
    /* the distance less the one at rest, written so that no digits cancel */
    const double distance = sqrt(dot(now, now)), stretch = dot(both, way) / (distance + c->length[m]);
    const double n[3] = {now[0] / distance, now[1] / distance, now[2] / distance}, opening = dot(n, rate);
    double along[2][3], about[2][3], lean[2] = {0};
    tangents(c, m, n, along, about, lean);
    const Normal normal = normal_of(c, c->overlap[m] - stretch, A, F, c->begun[m]);
    const double stiffness = c->B[m] * normal.radius;
    double repulsion = normal.repulsion, limit = repulsion + 2 * (c->jkr ? 0.75 : 1) * F, dashpot = 0;
    if (c->viscosity != 0 || c->loss >= 0) {
      dashpot = c->loss >= 0 ? sqrt(A * c->mass[m] * normal.radius) * c->loss : normal.radius > 0 ? c->viscosity : 0;
      repulsion -= dashpot * opening;
      if (!c->adheres) limit = fabs(repulsion);
    }
    double across[2], slipped[2] = {0}, spring[2] = {0}, shear[2] = {0}, grown[2] = {0}, square = 0;
    for (whole a = 0; a < T; a++) {
      slipped[a] = memory[a * M + m];
      across[a] = dot(along[a], rate);
      const double slip_rate = (across[a] - dot(about[a], turning)) * normal.closed;
      spring[a] = !c->incremental ? stiffness * slipped[a] : normal.closed != 0 ? slipped[a] : 0;
      shear[a] = spring[a] + c->shear * dashpot * slip_rate;
      grown[a] = c->incremental ? stiffness * slip_rate : slip_rate;
      square += shear[a] * shear[a];
    }
    const double size = sqrt(square);
    limit *= c->friction;
    if (c->friction < INFINITY && size > limit) { /* slides; in space the slip also turns faster than the limit alone takes it */
      const double follows = (grown[0] * shear[0] + grown[1] * shear[1]) / square;
      for (whole a = 0; a < T; a++) {
        if (d == 3 && limit > 0) grown[a] += (size / limit - 1) * (grown[a] - follows * shear[a]);
        const double left = shear[a] * (limit / size);
        spring[a] = left - (shear[a] - spring[a]);
        shear[a] = left;
      }
    }
    if (d == 3) {
      const double turns = (across[0] * lean[1] - lean[0] * across[1]) / distance;
      grown[0] += turns * slipped[1];
      grown[1] -= turns * slipped[0];
    }
    for (whole a = 0; a < T; a++) memory_rate[a * M + m] = grown[a];
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

/* Spheres in a row of chain.py: displacements and velocities in units of chain_motion.py; no dashpots are NULL. */
typedef struct {
  whole spheres;
  const double *stiffness, *overlap, *load, *mass, *dashpot;
  double length, speed;
} Chain;

/* Waves on the phase torus of K points, real or complex, as of lattice.py: a state has the rows p, q, φ, their rates,
   with `history` the shear of the contacts ahead, and with `works` the work of the shear law as of energy.py, (6 to 10,
   K) a wave. */
enum { BONDS = 3, MOST = 128 };
typedef struct {
  whole waves, points, history, incremental, potential, works;
  const double *shifts, *back; /* to the neighbours ahead (K, 3K), and its transpose */
  double along[BONDS], across[BONDS]; /* p and q of the directions at rest */
  double A, F, shear, length, overlap_ratio; /* a length of 0: directions are fixed */
  double depth, width, least; /* of JKR, as of network_laws.py and adhesion.py; a depth of 0: contacts are DMT's */
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

/* Newton's rule from the root of 3s⁴ − 2s = Re x to that of x, of which adhesion.py takes as many steps */
INLINE double root_near(double s, double x) { return s; }
INLINE double complex root_near_complex(double complex s, double complex x)
{
  for (int step = 0; step < 4; step++) {
    const double complex cube = s * s * s;
    s = ratio_complex(9 * cube * s + x, 12 * cube - 2);
  }
  return s;
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

/* The slope of a chain */
void OF(chain)(const Chain *c, const NUMBER *state, NUMBER *rate)
{
  const whole n = c->spheres;
  const double scale = c->length / (c->speed * c->speed);
  NUMBER left = 0, behind = 0; /* the sphere to the left of a contact, and the force of that before it */
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

/* Steps of chain_motion.py, whose parts have these halves, of chains that begin with their rates: (chains, 2, n) each */
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

/* What a contact is stretched by, from n·d and t·d */
INLINE NUMBER OF(stretched)(const Torus *t, NUMBER n, NUMBER s, NUMBER *distance)
{
  const NUMBER ahead = t->length + n, excess = (t->length + ahead) * n + s * s;
  *distance = t->length != 0 ? OF(root_of)(t->length * t->length + excess) : 1;
  return t->length != 0 ? OF(ratio)(excess, *distance + t->length) : n;
}

/* Radius, −f_N and the growth of the radius with the overlap (M) of contacts by JKR */
static void OF(adhered)(const Torus *t, const NUMBER apart[3][BONDS * MOST], NUMBER *radius, NUMBER *pull, NUMBER *growth)
{
  for (whole m = 0; m < BONDS * t->points; m++) {
    NUMBER distance;
    const NUMBER overlap = 1 - OF(stretched)(t, apart[0][m], apart[1][m], &distance);
    const NUMBER place = (creal(overlap) > t->least ? overlap : t->least) / t->depth;
    const double x = creal(place), fourth = 4 * x / 9, first = cbrt(2.0 / 9 + sqrt(4.0 / 81 + fourth * fourth * fourth));
    const double u = first - fourth / first, root = sqrt(u), near = (root + sqrt(4 / (3 * root) - u)) / 2;
    const double cube = near * near * near;
    const NUMBER s = OF(root_near)(near - (3 * cube * near - 2 * near - x) / (12 * cube - 2), place), y = s * s * s;
    const NUMBER spreading = t->depth * (6 * y * s - s);
    radius[m] = t->width * s * s;
    pull[m] = -3 * t->F * (y * y - y);
    growth[m] = creal(spreading) > 0 ? OF(ratio)(radius[m], spreading) : 0;
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
    NUMBER radius[BONDS * MOST], presses[BONDS * MOST], grows[BONDS * MOST];
    OF(deformed)(t, state, apart);
    if (t->depth != 0) OF(adhered)(t, apart, radius, presses, grows);
    if (t->history || t->works || t->dashpot != 0)
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
      const NUMBER sheared = t->history && t->incremental ? OF(ratio)(slip, t->shear * root) : slip;
      const NUMBER growth = t->depth != 0 ? grows[m] : creal(overlap) > 0 ? OF(ratio)(0.5, root) : 0;
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
