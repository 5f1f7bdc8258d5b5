/* The contact of spheres as one loop: LAMMPS's pair style granular for the laws of the decks.

   Two spheres of radii Ri, Rj at an overlap d and a slip s, Rc = Ri Rj/(Ri + Rj), push each other with f_N and f_S:

       hertz/material   f_N = K a d - c v,          limit = mu |f_N|,           a = sqrt(Rc d)
       dmt              f_N = K a d - F - c v,      limit = mu |K a d + F|,     a = sqrt(Rc d),  F = 4 pi gamma Rc
       jkr              f_N = K a^3/Rc - 4 sqrt(pi gamma E a^3) - c v,          limit = mu |f_N + c v + 2 F|,
                        d = a^2/Rc - 2 sqrt(pi gamma a/E),                      F = 3 pi gamma Rc
       jkr/distance     the same, but a contact ends at the largest distance, a^3 = pi gamma Rc^2/4E, and not at the
                        largest pull, 9 times that: LAMMPS does not have it
       mindlin          f_S = -8 G a s - xt c w;    mindlin/force sums -8 G a w dt instead of s

   with v and w the normal and tangential velocities of the surfaces, with the full radii, and c the dashpot: eta, or of
   a restitution e the one that grows with the force. No shear force is above the limit. s turns with the contact; the
   torque of f_S has the lever arm R - d/2. A contact that opens forgets its slip, and one that slides keeps that of its
   limit. All as in https://docs.lammps.org/pair_granular.html. The style is granular/kernel, which LAMMPS takes for
   granular under "suffix kernel", so that a deck needs no other line.

   LAMMPS's own style is made beside it and asked for all but the forces: it reads and checks the laws, sets the cutoffs,
   requests the neighbour list, and keeps slips, through checkpoints and on several ranks. What the loop does not know is
   an error.

   "fix ID group granular/kernel L" has the extremes of the contacts of a group over all steps since it was last asked:
   the smallest overlap; the largest shear force over the limit of its contact, at most 1; the most contacts that had
   opened or formed since the first step, on ranks at most; the steps at which the second was first above L and the third
   above 0, 1e30 if never. A checkpoint holds what had changed. */

#include "atom.h"
#include "comm.h"
#include "domain.h"
#include "error.h"
#include "fix.h"
#include "force.h"
#include "lammps.h"
#include "modify.h"
#include "neigh_list.h"
#include "pair.h"
#include "update.h"
#include "utils.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <unordered_map>
#include <vector>

using namespace LAMMPS_NS;

namespace {

enum Shear { NONE, SECANT, INCREMENTAL };    // tangential linear_nohistory, mindlin, mindlin/force

struct Law {    // of two types
  bool known = false, jkr = false, late = false, cohesive = false, restitution = false;
  Shear kind = NONE;
  double stiffness = 0, modulus = 0, surface = 0;    // K = 4/3 E, E and gamma of the contact
  double shear = 0, friction = 0;                    // 8 G, mu
  double damping = 0, ratio = 0;                     // eta, or the factor of a restitution; xt

  bool like(const Law &other) const { return jkr == other.jkr && kind == other.kind; }
};

// LAMMPS's fix NEIGH_HISTORY begins with these. That `pair` is the style it serves proves that they lie there
struct Slips : public Fix {
  int spheres, all, bit;
  int **touching;
  double **slip;    // of each pair of the neighbour list: x, y, z
  Pair *pair;
};

using Vectors = const double (*)[3];

struct Spheres {    // what the loop reads of them, so that the compiler keeps the addresses
  Vectors x, v, omega;
  const double *radius;
  double dt;

  explicit Spheres(const Atom *atom, double dt) :
      x((Vectors) atom->x[0]), v((Vectors) atom->v[0]), omega((Vectors) atom->omega[0]), radius(atom->radius), dt(dt)
  {
  }
};

struct Push {    // of one contact on its first sphere
  double normal, shear[3], overlap;
  double square = 0, limit = 1;    // of the shear force and of the most that it may be, both squared
};

// Contacts that opened, −1, or formed, 1, since the first step, by the tags of their spheres. Two spheres touch twice
// where a box is one of them wide
using Changes = std::unordered_map<uint64_t, int>;

struct Seen {    // the extremes of the contacts of a group
  static constexpr double NEVER = 1e30;
  int group;
  double most;    // share of the limit whose first step is kept
  double overlap = NEVER, square = 0, limit = 1;
  double slid = NEVER, left = NEVER;    // steps
  int changed = 0, largest = 0;
  bool read = true;

  Seen(int group, double most) : group(group), most(most) {}

  void begin(double step, bool setup)
  {
    if (read || setup) {
      overlap = NEVER;
      square = 0;
      limit = 1;
      largest = changed;
    }
    read = false;
    if (!setup) return;    // steps may have been counted anew
    if (slid > step) slid = NEVER;
    if (left > step) left = changed ? step : NEVER;
  }

  void see(int both, const Push &push, double step)
  {
    if (!(both & group)) return;
    if (push.overlap < overlap) overlap = push.overlap;
    if (push.square * limit > square * push.limit) {
      square = push.square;
      limit = push.limit;
      if (slid == NEVER && square > most * most * limit) slid = step;
    }
  }

  void change(int either, int more, double step)
  {
    if (!(either & group)) return;
    changed += more;
    if (changed > largest) largest = changed;
    if (changed && left == NEVER) left = step;
  }
};

class PairKernel : public Pair {
  Pair *granular;    // LAMMPS's own style
  Slips *slips = nullptr;
  std::vector<Law> laws;    // by both types
  Law usual;                // with what all laws have in common
  int frozen = 0;           // group bit of spheres that fix freeze holds: their mass is infinite
  Changes changes;
  std::vector<std::shared_ptr<Seen>> watched;
  bool moved = false;    // whether there was a step: before, contacts are those at rest

  // LAMMPS turns a slip only if its normal part matters by more than this share of the sliding force
  static constexpr double TURNED = 1e-10;

  Law &law(int m, int n) { return laws[m * (atom->ntypes + 1) + n]; }

  void adopt()
  {
    allocated = granular->allocated;
    setflag = granular->setflag;
    cutsq = granular->cutsq;
  }

  // The contact of i and j, which are d apart, r = |d|; its slip is changed
  template <bool SPACE, bool JKR, Shear KIND, bool DAMPED>
  Push meet(const Spheres &of, const Law &c, int i, int j, const double *d, double r, double *s, bool moves) const
  {
    constexpr int D = SPACE ? 3 : 2;
    const double ri = of.radius[i], rj = of.radius[j], overlap = ri + rj - r, Rc = ri * rj / (ri + rj), per = 1 / r;
    const double *vi = of.v[i], *vj = of.v[j];
    double n[3], u[3], un = 0;
    for (int k = 0; k < D; k++) n[k] = d[k] * per;
    if (KIND != NONE || DAMPED)
      for (int k = 0; k < D; k++) {
        u[k] = vi[k] - vj[k];
        un += u[k] * n[k];
      }

    double a, pull, force;    // the force without its dashpot
    if (JKR) {
      a = radius_of_jkr(c, overlap, Rc);
      pull = 3 * M_PI * c.surface * Rc;
      force = c.stiffness * a * a * a / Rc - 4 * a * std::sqrt(M_PI * c.surface * c.modulus * a);
    } else {
      a = std::sqrt(Rc * overlap);
      pull = 4 * M_PI * c.surface * Rc;
      force = c.stiffness * a * overlap - pull;
    }
    double loss = 0, normal = force;
    if (DAMPED) {
      loss = c.restitution ? c.damping * std::sqrt(mass(i, j) * force / overlap) : c.damping;
      normal -= loss * un;
    }
    Push push{normal, {0, 0, 0}, overlap};
    if (KIND == NONE) return push;

    const double shear = c.shear * a, limit = c.friction * std::fabs(c.cohesive ? force + 2 * pull : normal);
    const double *wi = of.omega[i], *wj = of.omega[j];
    double w[3], dashpot[3] = {0, 0, 0};
    const double spin = ri * wi[2] + rj * wj[2];
    if (SPACE) {
      const double wx = ri * wi[0] + rj * wj[0], wy = ri * wi[1] + rj * wj[1];
      w[0] = u[0] - un * n[0] - wy * n[2] + spin * n[1];
      w[1] = u[1] - un * n[1] - spin * n[0] + wx * n[2];
      w[2] = u[2] - un * n[2] - wx * n[1] + wy * n[0];
    } else {
      w[0] = u[0] - un * n[0] + spin * n[1];
      w[1] = u[1] - un * n[1] - spin * n[0];
    }
    if (moves) {
      double along = 0;
      for (int k = 0; k < D; k++) along += s[k] * n[k];
      if (std::fabs(along) * (KIND == SECANT ? shear : 1) > TURNED * limit) turn<D>(s, n, along);
      for (int k = 0; k < D; k++) s[k] += (KIND == SECANT ? 1 : -shear) * of.dt * w[k];
    }
    const double spring = KIND == SECANT ? -shear : 1;
    double square = 0;
    for (int k = 0; k < D; k++) {
      if (DAMPED) dashpot[k] = c.ratio * loss * w[k];
      push.shear[k] = spring * s[k] - dashpot[k];
      square += push.shear[k] * push.shear[k];
    }
    push.limit = limit * limit;
    push.square = square;
    if (square > push.limit) {
      push.square = push.limit = 1;
      const double part = limit / std::sqrt(square);
      bool any = !DAMPED;    // without a slip nothing but the dashpot pushes, and LAMMPS has none of it
      for (int k = 0; k < D; k++) any = any || s[k] != 0;
      for (int k = 0; k < D; k++) {
        push.shear[k] *= any ? part : 0;
        if (any) s[k] = (push.shear[k] + dashpot[k]) / spring;
      }
    }
    return push;
  }

  // a slip without its part along n, of the same length
  template <int D> static void turn(double *s, const double *n, double along)
  {
    double before = 0, after = 0;
    for (int k = 0; k < D; k++) {
      before += s[k] * s[k];
      s[k] -= along * n[k];
      after += s[k] * s[k];
    }
    const double scale = after > 0 ? std::sqrt(before / after) : 0;
    for (int k = 0; k < D; k++) s[k] *= scale;
  }

  // The larger root a of d = a^2/Rc - 2 sqrt(pi gamma a/E): with z the root of a in its natural unit, z^4 - z = y.
  // Newton's steps come from above, the first one from z = 1, where the spheres touch without overlap
  static double radius_of_jkr(const Law &c, double overlap, double Rc)
  {
    const double unit = std::cbrt(2 * Rc * std::sqrt(M_PI * c.surface / c.modulus)), area = unit * unit;
    const double y = overlap * Rc / (area * area);
    double z = 1 + y / 3;
    for (int step = 0; step < 60; step++) {
      const double cube = z * z * z, less = (z * cube - z - y) / (4 * cube - 1);
      z -= less;
      if (std::fabs(less) < 1e-9 * z) break;    // the next step would be the square of this one
    }
    return z * z * area;
  }

  // JKR's contacts begin at an overlap of 0 and end at the largest pull, as LAMMPS has it, or at the largest distance
  static bool holds_apart(const Law &c, double gap, double Rc)
  {
    const double a = std::cbrt((c.late ? 1 : 9) * M_PI * c.surface * Rc * Rc / (4 * c.modulus));
    return gap < 2 * std::sqrt(M_PI * c.surface * a / c.modulus) - a * a / Rc;
  }

  static bool touches(const Law &c, double rsq, double ri, double rj, bool before)
  {
    const double sum = ri + rj;
    return rsq < sum * sum || (c.jkr && before && holds_apart(c, std::sqrt(rsq) - sum, ri * rj / sum));
  }

  static uint64_t key(uint64_t first, uint64_t second) { return first << 32 | second; }

  // A contact of i and j has opened, −1, or formed, 1
  void change(int i, int j, int way)
  {
    int &net = changes[key(std::min(atom->tag[i], atom->tag[j]), std::max(atom->tag[i], atom->tag[j]))];
    const int before = std::abs(net), more = std::abs(net += way) - before;
    for (auto &each : watched) each->change(atom->mask[i] | atom->mask[j], more, update->ntimestep);
  }

  double mass(int i, int j) const
  {
    const double mi = atom->rmass[i], mj = atom->rmass[j];
    return atom->mask[i] & frozen ? mj : atom->mask[j] & frozen ? mi : mi * mj / (mi + mj);
  }

  template <bool SPACE, bool JKR, Shear KIND, bool DAMPED> void loop()
  {
    constexpr int D = SPACE ? 3 : 2;
    constexpr bool KEEPS = JKR || KIND != NONE;    // whether two spheres touched before
    const Spheres of(atom, update->dt);
    const Vectors x = of.x;
    const double *radius = of.radius;
    double(*force)[3] = (double(*)[3]) atom->f[0], (*torque)[3] = (double(*)[3]) atom->torque[0];
    const int *type = atom->type, nlocal = atom->nlocal, newton = this->force->newton_pair;
    const NeighList *pairs = granular->list;
    const bool moves = !update->setupflag;
    const double step = update->ntimestep;
    const int *mask = atom->mask;
    const std::shared_ptr<Seen> *watchers = watched.data();
    const std::size_t watching = watched.size();
    double none[3] = {0, 0, 0};

    for (int ii = 0; ii < pairs->inum; ii++) {
      const int i = pairs->ilist[ii], *neighbours = pairs->firstneigh[i], count = pairs->numneigh[i];
      const Law *row = &laws[type[i] * (atom->ntypes + 1)];
      int *touching = KEEPS ? slips->touching[i] : nullptr;
      double *s = KIND != NONE ? slips->slip[i] : none, on[3] = {0, 0, 0}, lever[3] = {0, 0, 0};
      for (int jj = 0; jj < count; jj++, s += KIND == NONE ? 0 : 3) {
        const int j = neighbours[jj] & NEIGHMASK;
        const Law &c = row[type[j]];
        double d[3] = {0, 0, 0}, rsq = 0;
        for (int k = 0; k < D; k++) {
          d[k] = x[i][k] - x[j][k];
          rsq += d[k] * d[k];
        }
        const double sum = radius[i] + radius[j];
        if (rsq >= sum * sum && !(JKR && touches(c, rsq, radius[i], radius[j], touching[jj]))) {
          if (KEEPS && touching[jj]) {
            touching[jj] = 0;
            change(i, j, -1);
          }
          if (KIND != NONE) s[0] = s[1] = s[2] = 0;
          continue;
        }
        if (KEEPS && !touching[jj]) {
          touching[jj] = 1;
          change(i, j, 1);
        }
        const double r = std::sqrt(rsq);
        const Push push = meet<SPACE, JKR, KIND, DAMPED>(of, c, i, j, d, r, s, moves);
        for (std::size_t w = 0; w < watching; w++) watchers[w]->see(mask[i] & mask[j], push, step);
        const double *g = push.shear, per = 1 / r, along = push.normal * per;
        double p[3] = {0, 0, 0};
        for (int k = 0; k < D; k++) {
          p[k] = along * d[k] + g[k];
          on[k] += p[k];
          if (newton || j < nlocal) force[j][k] -= p[k];
        }
        if (KIND != NONE) {    // -(n x g), times the lever arm of each
          const double inner = radius[i] - 0.5 * push.overlap, outer = radius[j] - 0.5 * push.overlap;
          const double t[3] = {(d[2] * g[1] - d[1] * g[2]) * per, (d[0] * g[2] - d[2] * g[0]) * per,
                               (d[1] * g[0] - d[0] * g[1]) * per};
          for (int k = SPACE ? 0 : 2; k < 3; k++) lever[k] += inner * t[k];
          if (newton || j < nlocal)
            for (int k = SPACE ? 0 : 2; k < 3; k++) torque[j][k] += outer * t[k];
        }
        if (evflag) ev_tally_xyz(i, j, nlocal, newton, 0.0, 0.0, p[0], p[1], p[2], d[0], d[1], d[2]);
      }
      for (int k = 0; k < D; k++) force[i][k] += on[k];
      for (int k = SPACE ? 0 : 2; k < 3; k++) torque[i][k] += lever[k];
    }
  }

  // What is known before the run chooses the loop: f is called with it as types
  template <class F> void choose(F f) const
  {
    using No = std::false_type;
    using Yes = std::true_type;
    auto of_damping = [&](auto space, auto jkr, auto kind) {
      usual.damping > 0 ? f(space, jkr, kind, Yes()) : f(space, jkr, kind, No());
    };
    auto of_shear = [&](auto space, auto jkr) {
      if (usual.kind == NONE) of_damping(space, jkr, std::integral_constant<Shear, NONE>());
      if (usual.kind == SECANT) of_damping(space, jkr, std::integral_constant<Shear, SECANT>());
      if (usual.kind == INCREMENTAL) of_damping(space, jkr, std::integral_constant<Shear, INCREMENTAL>());
    };
    auto of_normal = [&](auto space) { usual.jkr ? of_shear(space, Yes()) : of_shear(space, No()); };
    domain->dimension == 3 ? of_normal(Yes()) : of_normal(No());
  }

  // The words of a contact, one by one; what is not taken is an error
  struct Words {
    PairKernel *of;
    int count;
    char **words;
    int at = 0;

    std::string next() { return at < count ? words[at++] : ""; }
    double number() { return utils::numeric(FLERR, next(), false, of->lmp); }
    std::string one_of(const std::vector<std::string> &allowed, const std::string &what)
    {
      const std::string word = next();
      if (std::find(allowed.begin(), allowed.end(), word) != allowed.end()) return word;
      std::string names;
      for (const std::string &each : allowed) names += (names.empty() ? "" : ", ") + each;
      of->error->all(FLERR, "kernel: {} '{}': must be one of {}", what, word, names);
      return "";
    }
  };

  Law read(int count, char **given)
  {
    Words words{this, count, given};
    Law found;
    found.known = true;
    const std::string normal = words.one_of({"hertz/material", "dmt", "jkr", "jkr/distance"}, "normal law");
    const double E = words.number(), loss = words.number(), nu = words.number();
    found.modulus = E / (2 * (1 - nu * nu));
    found.stiffness = 4.0 / 3.0 * found.modulus;
    found.late = normal == "jkr/distance";
    found.jkr = normal == "jkr" || found.late;
    found.cohesive = normal != "hertz/material";
    if (found.cohesive) found.surface = words.number();
    words.one_of({"tangential"}, "word");
    const std::string law = words.one_of({"linear_nohistory", "mindlin", "mindlin/force"}, "tangential law");
    found.kind = law == "mindlin" ? SECANT : law == "mindlin/force" ? INCREMENTAL : NONE;
    if (found.kind == NONE) {
      if (words.number() != 0 || words.number() != 0) error->all(FLERR, "kernel: linear_nohistory must have 0 0");
    } else {
      const std::string stiffness = words.next();
      found.shear = stiffness == "NULL" ? 8 * E / (4 * (2 - nu) * (1 + nu)) : utils::numeric(FLERR, stiffness, false, lmp);
      found.ratio = words.number();
      found.friction = words.number();
    }
    words.one_of({"damping"}, "word");
    found.restitution = words.one_of({"velocity", "coeff_restitution"}, "damping law") == "coeff_restitution";
    if (words.at < count) error->all(FLERR, "kernel: takes no '{}' in a contact", words.next());
    const double logarithm = found.restitution ? std::log(loss) : 0;
    found.damping = found.restitution ? -std::sqrt(5) * logarithm / std::hypot(M_PI, logarithm) : loss;
    return found;
  }

 public:
  PairKernel(LAMMPS *lmp) : Pair(lmp)
  {
    int suffix;
    granular = force->new_pair("granular", 0, suffix);
    if (!granular) error->all(FLERR, "kernel: this LAMMPS has no pair_style granular");
    restartinfo = granular->restartinfo;
    no_virial_fdotr_compute = 1;
    finitecutflag = 1;
    single_extra = granular->single_extra;
    svector = new double[single_extra]();
  }

  ~PairKernel() override
  {
    delete[] svector;
    delete granular;
  }

  void settings(int count, char **words) override
  {
    if (count) error->all(FLERR, "kernel: pair_style granular takes no cutoff");
    granular->settings(count, words);
    if (comm->me == 0) utils::logmesg(lmp, "Contacts are computed by granular/kernel\n");
  }

  void coeff(int count, char **words) override
  {
    if (laws.empty()) laws.resize((atom->ntypes + 1) * (atom->ntypes + 1));
    const Law found = read(count - std::min(count, 2), words + std::min(count, 2));
    char *const normal = words[2];
    static char jkr[] = "jkr";
    if (found.late) words[2] = jkr;
    granular->coeff(count, words);
    words[2] = normal;
    adopt();
    int low[2], high[2];
    for (int side = 0; side < 2; side++) utils::bounds(FLERR, words[side], 1, atom->ntypes, low[side], high[side], error);
    for (int m = low[0]; m <= high[0]; m++)
      for (int n = std::max(low[1], m); n <= high[1]; n++) law(m, n) = law(n, m) = found;
  }

  void init_style() override
  {
    if (!modify->get_fix_by_style("^rigid").empty()) error->all(FLERR, "kernel: takes no rigid bodies");
    usual = Law();
    for (int m = 1; m <= atom->ntypes; m++)
      for (int n = m; n <= atom->ntypes; n++) {
        if (laws.empty() || !law(m, n).known) error->all(FLERR, "kernel: types {} and {} have no pair_coeff", m, n);
        if (usual.known && !usual.like(law(m, n))) error->all(FLERR, "kernel: all contacts must have the same laws");
        const double most = std::max(usual.damping, law(m, n).damping);
        usual = law(m, n);
        usual.damping = most;
      }
    granular->init_style();
    slips = nullptr;    // of a chain of spheres that have no shear there are none
    for (Fix *each : modify->get_fix_by_style("^NEIGH_HISTORY"))
      if (((Slips *) each)->pair == granular) slips = (Slips *) each;
    if ((usual.kind != NONE || usual.jkr) && !slips) error->all(FLERR, "kernel: this LAMMPS keeps its slips elsewhere");
    frozen = 0;
    for (Fix *each : modify->get_fix_by_style("^freeze")) frozen |= each->groupbit;
  }

  double init_one(int m, int n) override { return granular->init_one(m, n); }
  void reset_dt() override { granular->reset_dt(); }
  void write_restart(FILE *file) override { granular->write_restart(file); }
  void read_restart(FILE *file) override
  {
    granular->read_restart(file);
    adopt();
  }

  void compute(int eflag, int vflag) override
  {
    ev_init(eflag, vflag);
    moved = moved || !update->setupflag;
    for (auto &each : watched) each->begin(update->ntimestep, update->setupflag);
    choose([&](auto space, auto jkr, auto kind, auto damped) {
      loop<decltype(space)::value, decltype(jkr)::value, decltype(kind)::value, decltype(damped)::value>();
    });
    if (moved) return;
    changes.clear();
    for (auto &each : watched) {
      each->changed = each->largest = 0;
      each->left = Seen::NEVER;
    }
  }

  // What is seen of the contacts of a group from now on
  void watch(const std::shared_ptr<Seen> &by)
  {
    if (usual.known && usual.kind == NONE && !usual.jkr) error->all(FLERR, "kernel: contacts without shear have no past");
    watched.push_back(by);
    for (const auto &[pair, net] : changes) {
      const int one = atom->map(pair >> 32), other = atom->map(pair & 0xffffffff);
      by->change((one < 0 ? 0 : atom->mask[one]) | (other < 0 ? 0 : atom->mask[other]), std::abs(net), Seen::NEVER);
    }
  }

  // Where a continued run begins: the group may have held other spheres when their contacts changed
  void restore(const std::shared_ptr<Seen> &by, int changed, const double *triples, int count)
  {
    by->changed = comm->me ? 0 : changed;
    for (int k = 0; k < count && comm->me == 0; k++, triples += 3) changes[key(triples[0], triples[1])] = triples[2];
    moved = true;
  }

  std::vector<double> changed() const
  {
    std::vector<double> triples;
    for (const auto &[pair, net] : changes)
      if (net) triples.insert(triples.end(), {double(pair >> 32), double(pair & 0xffffffff), double(net)});
    return triples;
  }

  // For compute pair/local: p1 to p3 are the shear force on i, p4 its magnitude, p10 to p12 the vector from j to i
  double single(int i, int j, int m, int n, double rsq, double, double, double &fforce) override
  {
    std::fill_n(svector, single_extra, 0.0);
    fforce = 0.0;
    const Law &c = law(m, n);
    double none[3] = {0, 0, 0}, *s = none;
    const double way = find(i, j, s), ri = atom->radius[i], rj = atom->radius[j];
    if (!touches(c, rsq, ri, rj, way != 0)) return 0.0;
    if (c.kind != NONE && s == none) error->one(FLERR, "kernel: a contact that is in no neighbour list");
    const int first = way < 0 ? j : i, second = way < 0 ? i : j;
    double d[3], r = std::sqrt(rsq);
    for (int k = 0; k < 3; k++) d[k] = atom->x[first][k] - atom->x[second][k];
    Push push{};
    choose([&](auto space, auto jkr, auto kind, auto damped) {
      push = meet<decltype(space)::value, decltype(jkr)::value, decltype(kind)::value, decltype(damped)::value>(
          Spheres(atom, update->dt), c, first, second, d, r, s, false);
    });
    fforce = push.normal / r;
    for (int k = 0; k < 3; k++) {
      svector[k] = (way < 0 ? -1 : 1) * push.shear[k];
      svector[9 + k] = (way < 0 ? -1 : 1) * d[k];
      svector[3] += push.shear[k] * push.shear[k];
    }
    svector[3] = std::sqrt(svector[3]);
    return 0.0;
  }

 private:
  // Where the slip of i and j lies: 1, or -1 where it is that of j and i; 0 if they did not touch before
  double find(int i, int j, double *&s) const
  {
    if (!slips) return 0;
    const NeighList *pairs = granular->list;
    for (const int way : {1, -1}) {
      const int first = way > 0 ? i : j, second = way > 0 ? j : i;
      if (first >= atom->nlocal) continue;
      for (int k = 0; k < pairs->numneigh[first]; k++)
        if ((pairs->firstneigh[first][k] & NEIGHMASK) == second) {
          if (usual.kind != NONE) s = &slips->slip[first][3 * k];
          return slips->touching[first][k] ? way : 0;
        }
    }
    return 0;
  }
};

class FixKernel : public Fix {
  PairKernel *style;
  std::shared_ptr<Seen> seen;
  double extremes[5] = {Seen::NEVER, 0, 0, Seen::NEVER, Seen::NEVER};

 public:
  FixKernel(LAMMPS *lmp, int count, char **words) : Fix(lmp, count, words), style(dynamic_cast<PairKernel *>(force->pair))
  {
    if (!style || count != 4) error->all(FLERR, "kernel: fix ID GROUP granular/kernel LIMIT needs pair_style granular");
    style->watch(seen = std::make_shared<Seen>(groupbit, utils::numeric(FLERR, words[3], false, lmp)));
    vector_flag = restart_global = dynamic_group_allow = global_freq = 1;
    size_vector = 5;
    extvector = 0;
  }

  ~FixKernel() override
  {
    if (seen) seen->group = 0;
  }

  int setmask() override { return 0; }

  double compute_vector(int which) override
  {
    if (!seen->read) {
      const double share = std::sqrt(seen->square / seen->limit), changed = seen->largest;
      const double own[] = {-seen->overlap, share, changed, -seen->slid, -seen->left};
      MPI_Allreduce(own, extremes, 5, MPI_DOUBLE, MPI_MAX, world);
      MPI_Allreduce(&changed, &extremes[2], 1, MPI_DOUBLE, MPI_SUM, world);
      for (const int least : {0, 3, 4}) extremes[least] *= -1;
      seen->read = true;
    }
    return extremes[which];
  }

  void write_restart(FILE *file) override
  {
    const std::vector<double> own = style->changed();
    const int count = own.size();
    std::vector<int> counts(comm->nprocs), places(comm->nprocs);
    MPI_Gather(&count, 1, MPI_INT, counts.data(), 1, MPI_INT, 0, world);
    for (int rank = 1; rank < comm->nprocs; rank++) places[rank] = places[rank - 1] + counts[rank - 1];
    std::vector<double> all(2 + places.back() + counts.back());
    MPI_Gatherv(own.data(), count, MPI_DOUBLE, &all[2], counts.data(), places.data(), MPI_DOUBLE, 0, world);
    const double changed = seen->changed;
    MPI_Reduce(&changed, &all[1], 1, MPI_DOUBLE, MPI_SUM, 0, world);
    if (comm->me) return;
    all[0] = (all.size() - 2) / 3;
    const int size = all.size() * sizeof(double);
    fwrite(&size, sizeof(int), 1, file);
    fwrite(all.data(), sizeof(double), all.size(), file);
  }

  void restart(char *state) override
  {
    const double *all = (double *) state;
    style->restore(seen, all[1], all + 2, all[0]);
  }
};

Pair *make(LAMMPS *lmp)
{
  return new PairKernel(lmp);
}

Fix *make_fix(LAMMPS *lmp, int count, char **words)
{
  return new FixKernel(lmp, count, words);
}

// What a plugin says of itself: https://docs.lammps.org/Developer_plugins.html
struct Plugin {
  const char *version, *style, *name, *info, *author;
  union {
    void *(*plain)(LAMMPS *);
    void *(*with_words)(LAMMPS *, int, char **);
  } creator;
  void *handle;
};

}    // namespace

extern "C" void lammpsplugin_init(void *lmp, void *handle, void *registration)
{
  Plugin said{};
  said.version = ((LAMMPS *) lmp)->version;
  said.style = "pair";
  said.name = "granular/kernel";
  said.info = "contacts of granular-lmp";
  said.author = "granular-lmp";
  said.creator.plain = (void *(*) (LAMMPS *) ) & make;
  said.handle = handle;
  ((void (*)(Plugin *, void *)) registration)(&said, lmp);
  said.style = "fix";
  said.creator.with_words = (void *(*) (LAMMPS *, int, char **) ) & make_fix;
  ((void (*)(Plugin *, void *)) registration)(&said, lmp);
}
