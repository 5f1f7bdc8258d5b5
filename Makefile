# Both commands set everything up by themselves: Python ≥ 3.11, make and internet are enough.
#
#   make paper   the paper's three cases through LAMMPS, compared with theory: runs/paper/, figures and a table
#   make test    all tests, with the linter and the type checker
#
# Also: make spectrum (the paper's figure 2 by simulation, a few minutes: docs/spectrum.md),
# make dispersion (all branches from one kicked sheet), make waves (other directions, gratings, driven rows and
# pulses, a minute: docs/waves.md), make figures (those of README and of the docs, into figures/),
# make processors (the tests that depend on last digits, as on other processors; make test does it too),
# make stability (hard cases, a few minutes: docs/stability.md),
# make guards (how often a guard is wrong, of 232 random scenes, ten minutes: docs/effects.md),
# make ladders (how often a tolerance is missed, of 168 random scenes, and its cost, ten minutes: docs/accuracy.md),
# make impact (the solitary wave, and error over cost of an impact, a minute: docs/strongly-nonlinear.md),
# make published (published cases of impacts, three minutes: docs/published-impacts.md),
# make pull-off (snap-in and pull-off in collisions, by JKR and in LAMMPS, half a minute: docs/collisions.md),
# make adhesion (the second harmonic by the DMT and by the JKR law, ten minutes of processor time: docs/adhesion-laws.md),
# make onset (where contacts of the paper's wave open and slide, eight minutes: docs/strongly-nonlinear.md),
# make witness (error over time in a crystal that is not perfect, half a minute: docs/accuracy.md; and the network beside
# LAMMPS over the number of spheres, five minutes: benchmarks/RESULTS.md),
# make scattering (what passes rows that differ, and the second harmonic behind: docs/experiments.md),
# make disorder (what unequal spheres and defects do to waves, quarter of an hour: docs/imperfect.md),
# make quiet (what quiet ends reflect, by theory and in LAMMPS, twenty minutes: docs/waves.md),
# make cost (seconds against error of every knob, ten minutes: docs/accuracy.md),
# make gallery (the pictures of docs/gallery.md, by the commands on that page),
# make bench (our run beside other codes, with the error of each), make scale (cost up to a million spheres),
# make docs (the documentation site, into site/), make rooms (the drawing of docs/architecture.md),
# make notebook (the tutorial, executed, into docs/tutorial.ipynb; twenty seconds),
# make versioned-docs (the site of this version beside those of others, onto the branch gh-pages: RELEASING.md),
# make decks (rewrites the committed decks of lammps_inputs), make clean.

PYTHON ?= python3
BIN = .venv/bin
CASES = tr_nonresonant tr_resonant tr_antiresonant
# A quarter of the scenes' own step: what is left of the error is the theory's, not the integrator's.
STEP = 0.0125
# The walls are heard at the centre from tau = 167 on; the third harmonic at the resonance takes that long to show.
UNTIL = 165
RUNS = $(CASES:%=runs/paper/%)
CORES := $(shell getconf _NPROCESSORS_ONLN)
# Matrices are small here: threads of OpenBLAS take a quarter of the processor time and give nothing
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: paper figures spectrum dispersion waves quiet scattering disorder gallery test processors stability guards ladders impact published pull-off onset adhesion witness cost bench \
    scale decks docs versioned-docs notebook rooms clean $(RUNS) runs/paper/compare.txt runs/paper/figure2.png runs/paper/figure3.png

# What does not wait for one another runs side by side
paper: .venv/ready
	$(MAKE) --no-print-directory --jobs=$(CORES) runs/paper/compare.txt runs/paper/figure2.png runs/paper/figure3.png
	cat runs/paper/compare.txt

$(RUNS): runs/paper/%: .venv/ready
	$(BIN)/granular-lmp run $* --set time.timestep=$(STEP) --set time.duration=$(UNTIL) -o $@ --force

runs/paper/compare.txt: $(RUNS)
	$(BIN)/python -m analysis.compare $(RUNS) --json runs/paper/compare.json > $@

runs/paper/figure2.png: .venv/ready
	$(BIN)/granular-analysis figure2 -o $@

runs/paper/figure3.png: $(RUNS)
	$(BIN)/granular-analysis figure3 $(RUNS) -o $@

# The second harmonic over wave number, by what the scene leaves out or adds
EFFECTS = paper no_rotation incremental compressed damped
no_rotation = --set effects.rotation=false
incremental = --set effects.shear_law=incremental
compressed = --set sphere.work_of_adhesion=0.0 --set packing.contact_force=9.896016858807847e-08
damped = --set effects.viscosity=1e-7

.PHONY: $(EFFECTS:%=runs/effects/%)
$(EFFECTS:%=runs/effects/%): runs/effects/%: .venv/ready
	$(BIN)/granular-lmp sweep tr_periodic --over wave.wavenumber=0.0785398:3.0630528:39 --workers $(CORES) -o $@ \
	    --set packing.rows=80 --set wave.amplitude=0.02 --set time.duration=60 --set time.timestep=0.0125 $($*)

# Into the repository. The bytes of a PNG depend on the versions of matplotlib and FreeType, and on last digits
figures: paper $(EFFECTS:%=runs/effects/%)
	cp runs/paper/figure2.png figures/figure2.png
	cp runs/paper/figure3.png figures/figure3.png
	$(BIN)/granular-analysis effects $(EFFECTS:%=runs/effects/%) -o figures/effects.png
	$(BIN)/granular-analysis convergence -o figures/convergence.png
	$(BIN)/granular-analysis laws -o figures/laws.png
	$(BIN)/granular-analysis map -o figures/map.png
	$(BIN)/granular-analysis mixing -o figures/mixing.png
	$(BIN)/granular-analysis timestep -o figures/timestep.png

# The paper's figure 2 (b, c) by simulation, from pairs of runs. The cell of 128 rows carries 2π·4/128 to 2π·63/128; that
# of 400 the wave numbers around resonance, 2π·91/400 to 2π·97/400, and antiresonance, 2π·133/400 to 2π·138/400.
SPECTRUM = --workers $(CORES) --set wave.amplitude=0.02 --set time.duration=120 --over time.timestep=0.05,0.025

spectrum: .venv/ready
	$(BIN)/granular-lmp sweep tr_periodic $(SPECTRUM) --set packing.rows=128 -o runs/spectrum/zone \
	    --over wave.mode=TR,RT,L --over wave.wavenumber=0.1963495408:3.0925052684:60
	$(BIN)/granular-lmp sweep tr_periodic $(SPECTRUM) --set packing.rows=400 -o runs/spectrum/close \
	    --over wave.wavenumber=1.4294246574:1.5236724369:7,2.0891591146:2.1676989309:6
	$(BIN)/granular-analysis spectrum runs/spectrum/zone runs/spectrum/close -o figures/spectrum.png

gallery: .venv/ready
	sed -n 's/^\$$ //p' docs/gallery.md | PATH="$(CURDIR)/$(BIN):$$PATH" sh -ex

# All branches at once: a sheet kicked at random
dispersion: .venv/ready
	$(BIN)/granular-lmp kick tr_periodic --set packing.rows=48 --set packing.columns=48 --set wave.amplitude=0.01 \
	    --set time.duration=512 --set time.sample=1.5 -o runs/dispersion --force
	$(BIN)/granular-analysis dispersion runs/dispersion/sheet.npz -o figures/dispersion.png

# Waves of other directions, over pairs of steps for Richardson's extrapolation; and finite ones, beside their theories
waves: .venv/ready
	$(BIN)/granular-lmp sweep tr_oblique --workers $(CORES) -o runs/waves/oblique \
	    --set packing.rows=48 --set packing.columns=48 --set wave.wavenumber=1.0472 --set wave.amplitude=0.02 \
	    --set output.particles=4.0 --over wave.mode=TR,RT,L --over time.timestep=0.05,0.025 \
	    --over wave.direction=0,14.4,22,30,39.5,49.1,63.7,77.8,83.8,90
	$(BIN)/granular-analysis oblique runs/waves/oblique -o figures/oblique.png
	for scene in tr_grating tr_driven tr_pulse; do $(BIN)/granular-lmp run $$scene -o runs/waves/$$scene --force || exit 1; done
	$(BIN)/granular-analysis standing runs/waves/tr_grating -o figures/grating.png
	$(BIN)/granular-analysis driven runs/waves/tr_driven -o figures/driven.png
	$(BIN)/granular-analysis sheets runs/waves/tr_pulse -o figures/pulse.png
	$(BIN)/granular-lmp run two_tones -o runs/waves/two_tones --force
	$(BIN)/granular-analysis tones runs/waves/two_tones -o figures/two_tones.png
	$(BIN)/granular-lmp run point_source -o runs/waves/point_source --force
	$(BIN)/granular-lmp view runs/waves/point_source -o figures/point_source.png --rows 31 --tau 26 --colour q
	$(BIN)/granular-lmp run corner_source -o runs/waves/corner_source --force
	$(BIN)/granular-lmp view runs/waves/corner_source -o figures/corner_source.png --tau 34 --colour energy
	$(BIN)/granular-lmp sweep quiet_ends --workers $(CORES) --over source.1.frequency=0.3:0.8:51 -o runs/waves/response
	$(BIN)/granular-lmp view runs/waves/response -o figures/response.png --column behind.v2

# What quiet ends reflect: driven rows in steady state. Slow waves take longer
QUIET = tr_driven --workers $(CORES) --set time.timestep=0.1 --set absorb.rows=10 --set absorb.reflection=0.5 \
    --set packing.rows=31 --set wave.amplitude=0.001 --set envelope.ramp=150 --set time.sample=2 --set output.particles=2

quiet: .venv/ready
	$(BIN)/granular-lmp sweep $(QUIET) -o runs/quiet/fast --set time.duration=520 --over absorb.rows=5,10 \
	    --over wave.mode=L,TR,RT --over wave.wavenumber=1.0,1.4,1.8,2.2
	$(BIN)/granular-lmp sweep $(QUIET) -o runs/quiet/slow --set time.duration=1200 --over absorb.rows=5,10 \
	    --over wave.mode=L,TR,RT --over wave.wavenumber=0.6
	$(BIN)/python -m granular_lmp.plot.reflection runs/quiet/fast runs/quiet/slow -o figures/quiet_ends.png

# A wave meets rows that differ. Spheres three times as stiff that adhere three times as much overlap alike
SCATTER = $(BIN)/granular-lmp scatter tr_burst_scattering --force
SCATTERED = heavy light interface empty longitudinal rt

scattering: .venv/ready
	$(SCATTER) -o runs/scattering/heavy --tones 3 --set name=heavy
	$(SCATTER) -o runs/scattering/light --set name=light --set 'inclusion=[{rows=[69,69],density=440.0}]'
	$(SCATTER) -o runs/scattering/interface --tones 1 --set name=interface \
	    --set 'inclusion=[{rows=[69,130],youngs_modulus=219e9,work_of_adhesion=0.189,poisson_ratio=0.3}]'
	$(SCATTER) -o runs/scattering/empty --set name=empty_places --set time.duration=440 --set 'inclusion=[{spheres=[[69,1]],vacancy=true}]'
	$(SCATTER) -o runs/scattering/longitudinal --tones 1 --set name=longitudinal --set wave.mode=L \
	    --set wave.wavenumber=1.0 --set source.1.force=y
	$(SCATTER) -o runs/scattering/rt --set name=rt --set wave.mode=RT --set wave.wavenumber=1.9 \
	    --set source.1.cycles=16.0 --set time.timestep=0.05 --set time.sample=0.5 \
	    --set output.particles=0.5 --set time.duration=460
	$(BIN)/granular-analysis scatter $(SCATTERED:%=runs/scattering/%) -o figures/scattering.png
	rm -rf runs/scattering/behind
	$(BIN)/granular-lmp sweep tr_burst_scattering -o runs/scattering/behind --workers $(CORES) \
	    --set packing.rows=151 --set wave.wavenumber=0.802 --set wave.amplitude=0.1 --set absorb.reflection=1e-3 \
	    --set time.duration=620 --set 'source=[{rows=[40,40],force="x",signal="tone",ramp=60.0}]' \
	    --set 'inclusion=[{rows=[52,150],youngs_modulus=219e9,work_of_adhesion=0.189}]' \
	    --over 'inclusion.1.rows=[52,150],[56,150],[60,150],[64,150],[68,150],[72,150]'
	$(BIN)/granular-analysis behind runs/scattering/behind -o figures/behind.png

# What disorder does, over seeds, by kinds of runs: docs/imperfect.md. Waves of both signs part the second harmonic from
# what disorder scatters into 2k. Wave numbers are 2πn/68 and 2πn/136, near the resonance, 1.475, and the antiresonance,
# 2.127; a wave at 2π/4 would have 2k = π, which runs neither way. Contacts of the widest spread slide: friction 0.5.
DISORDER = $(BIN)/granular-lmp sweep --workers $(CORES)
TURNING = tr_periodic --set packing.columns=8 --set wave.amplitude=0.05 --set time.duration=100 \
    --set time.timestep=0.1 --set time.sample=1 --set effects.contact_opening=true --set output.particles=20
SIGNS = --over wave.phase=0.0,3.141592653589793
BOTH = --over wave.wavenumber=1.4784,2.1252
NEAR = 1.3398,1.3860,1.4322,1.4784,1.5246,1.6170
SLIDING = --set effects.sliding=true --set effects.friction=0.5
STILL = tr_periodic --set packing.rows=18 --set packing.columns=16 --set wave.wavenumber=0.6981 \
    --set wave.amplitude=0.001 --set time.duration=1 --set effects.contact_opening=true --over disorder.seed=1:32:32
SWEPT = perfect harmonic torn compressed shape contacts contacts_soft contacts_rubbed density sound
DEFECT = tr_periodic --set packing.rows=64 --set packing.columns=48 --set wave.wavenumber=0.7853981633974483 \
    --set wave.amplitude=0.01 --set time.duration=80 --set time.timestep=0.1 --set output.particles=4

disorder: .venv/ready
	$(DISORDER) $(TURNING) -o runs/disorder/perfect --set packing.rows=136 --over wave.wavenumber=$(NEAR),2.1252 $(SIGNS)
	$(DISORDER) $(TURNING) -o runs/disorder/harmonic --set packing.rows=68 \
	    --over disorder.radius=2.5e-5,5e-5,7.5e-5,1e-4,1.25e-4,1.75e-4 --over disorder.seed=1:32:32 $(BOTH) $(SIGNS)
	$(DISORDER) $(TURNING) -o runs/disorder/torn --set packing.rows=68 $(SLIDING) \
	    --over disorder.radius=2.5e-4 --over disorder.seed=1:16:16 $(BOTH) $(SIGNS)
	$(DISORDER) $(TURNING) -o runs/disorder/compressed --set packing.rows=68 $(SLIDING) \
	    --set sphere.work_of_adhesion=0.0 --set packing.contact_force=9.896016858807847e-08 \
	    --over disorder.radius=2.5e-5,5e-5,7.5e-5,1e-4,1.25e-4,1.75e-4,2.5e-4 --over disorder.seed=1:16:16 $(BOTH) $(SIGNS)
	$(DISORDER) $(TURNING) -o runs/disorder/shape --set packing.rows=136 --over disorder.radius=5e-5,1e-4 \
	    --over disorder.seed=1:8:8 --over wave.wavenumber=$(NEAR) $(SIGNS)
	$(DISORDER) $(STILL) -o runs/disorder/contacts --over disorder.radius=1e-5,3e-5,1e-4,2e-4,3e-4,5e-4,1e-3,3e-3,1e-2
	$(DISORDER) $(STILL) -o runs/disorder/contacts_soft --set sphere.youngs_modulus=2.3085e9 \
	    --over disorder.radius=1e-4,3e-4,1e-3,2e-3,3e-3,5e-3,1e-2,3e-2
	$(DISORDER) $(STILL) -o runs/disorder/contacts_rubbed --set packing.relax_friction=0.3 \
	    --over disorder.radius=1e-4,2e-4,3e-4,5e-4,1e-3,3e-3
	$(DISORDER) tr_periodic -o runs/disorder/density --set packing.rows=64 --set packing.columns=32 \
	    --set wave.amplitude=0.001 --set time.duration=75 --set time.timestep=0.2 --set time.sample=5 \
	    --set output.particles=25 --set disorder.density=0.1 --over disorder.seed=1:32:32 --over wave.mode=TR,L \
	    --over wave.wavenumber=0.3927,0.5890,0.7854,1.1781,1.5708,1.9635
	$(DISORDER) steel_compressed -o runs/disorder/sound --set packing.rows=64 --set packing.columns=16 --set wave.mode=L \
	    --set wave.wavenumber=0.19635 --set wave.amplitude=0.001 --set time.duration=64 --set time.timestep=0.2 \
	    --set time.sample=4 --set output.particles=8 --set effects.contact_opening=true $(SLIDING) \
	    --set disorder.radius=2e-5 --over disorder.seed=1:4:4 --over packing.contact_force=0.3,0.5,1,2,5,10,30,100
	$(BIN)/granular-analysis disorder $(SWEPT:%=runs/disorder/%) -o figures/disorder.png
	$(BIN)/granular-lmp run $(DEFECT) -o runs/disorder/whole --force
	$(BIN)/granular-lmp run $(DEFECT) -o runs/disorder/vacancy --force \
	    --set 'inclusion=[{spheres=[[30,24]],vacancy=true}]'
	$(BIN)/granular-lmp run $(DEFECT) -o runs/disorder/heavy --force \
	    --set 'inclusion=[{spheres=[[30,24]],density=22000.0}]'
	$(BIN)/granular-analysis defects runs/disorder/whole runs/disorder/vacancy runs/disorder/heavy \
	    -o figures/defects.png

test: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/pytest --numprocesses=auto --dist=loadfile
	$(BIN)/python -m tests.processors

processors: .venv/ready
	$(BIN)/python -m tests.processors

stability: .venv/ready
	$(BIN)/python -m tests.hard.report -o docs/stability.md
	$(BIN)/pytest tests/hard/test_bad_input.py tests/hard/test_broken_decks.py --hypothesis-profile=thorough

guards: .venv/ready
	$(BIN)/python -m tests.hard.guard_study --write docs/effects.md

ladders: .venv/ready
	$(BIN)/python -m tests.hard.ladder_study --write docs/accuracy.md

FRONTS = --set packing.rows=61 --set packing.columns=101 --set "striker.1.spheres=[[0, 50]]" --set time.duration=80.0 --set time.sample=0.4

FORCES = 0.1 0.3 1 3 10 30 60 100 200
PRESSED = --set packing.rows=300 --set packing.last=free --set time.duration=340.0 --set time.sample=0.12 \
    --set "output.spheres=[[239, 0], [240, 0], [279, 0], [280, 0]]"

impact: .venv/ready
	$(BIN)/granular-lmp run point_impact $(FRONTS) -o runs/impact/smooth --force
	$(BIN)/granular-lmp run point_impact $(FRONTS) --set effects.friction=0.3 -o runs/impact/rough --force
	$(BIN)/granular-analysis fronts runs/impact/smooth runs/impact/rough -o figures/fronts.png
	for force in $(FORCES); do $(BIN)/granular-lmp run compressed_chain $(PRESSED) --set packing.contact_force=$$force \
	    -o runs/impact/force-$$force --force || exit 1; done
	$(BIN)/granular-analysis solitary $(FORCES:%=runs/impact/force-%) -o figures/solitary.png
	$(BIN)/granular-analysis impact -o figures/impact.png

# Published cases of impacts: docs/published-impacts.md. Densities of light spheres beside heavy ones of 10000 kg/m3: the
# resonances, the antiresonances and some between
DIMERS = 450 615.03 760 901.28 1225 1547.5 2000 2399 3000 3428.46 4500 5300 5782 6500 7500 9000
# Angle of an interface and density beyond it, with 7800 kg/m3 before
INTERFACES = 0:15600 15:15600 30:15600 45:15600 60:15600 0:31200 15:31200 30:31200 45:31200 60:31200 \
    0:3900 10:3900 20:3900 30:3900 40:3900 0:1950 10:1950 15:1950
SHEET = $(BIN)/granular-lmp run refraction --set packing.rows=90 --set output.rows=[34,66] --set time.duration=110
# Spreads of radii, and the spheres in the directions of the fit: recorded alone, as all would fill 3 GB
LOOSE = 2.5e-6 7.5e-6 2.5e-5 7.5e-5
LINES = $(shell $(PYTHON) -c 'print([[k, c] for k in range(5, 37) for c in sorted({50, 50 + k // 2, 50 - (k + 1) // 2, \
    50 + 3 * k // 2, 50 - (3 * k + 1) // 2}) if 0 <= c <= 100])')
POINT = $(BIN)/granular-lmp run point_impact --force $(FRONTS) --set time.duration=90.0 --set time.sample=0.5 --set 'output.spheres=$(LINES)'

published: .venv/ready
	for density in $(DIMERS); do $(BIN)/granular-lmp run dimer_chain -o runs/published/dimer_$$density --force \
	    --set inclusion.1.density=$$density --set time.sample=0.15 --set time.duration=110 --set output.rows=[30,76] || exit 1; done
	$(BIN)/granular-analysis dimers $(DIMERS:%=runs/published/dimer_%) -o figures/dimers.png
	rm -rf runs/published/refraction
	for each in $(INTERFACES); do $(SHEET) -o runs/published/refraction/$$(echo $$each | tr : _) \
	    --set inclusion.1.half_plane=[50,20,$${each%:*}] --set inclusion.1.density=$${each#*:} || exit 1; done
	$(BIN)/granular-analysis refraction runs/published/refraction/* -o figures/refraction.png
	rm -rf runs/published/unequal
	$(POINT) -o runs/published/unequal/equal
	for spread in $(LOOSE); do for seed in 1 2 3 4 5 6; do $(POINT) -o runs/published/unequal/$${spread}_$$seed \
	    --set disorder.radius=$$spread --set disorder.seed=$$seed || exit 1; done; done
	$(BIN)/granular-analysis unequal runs/published/unequal/* -o figures/unequal.png

# Two spheres that meet with 0.2 to 4 m/s. They stick below 0.438 m/s
SNAPS = 0.1 0.15 0.2 0.217 0.22 0.23 0.25 0.3 0.4 0.5 0.7 1.0 1.5 2.0

pull-off: .venv/ready
	for law in jkr dmt; do for speed in $(SNAPS); do $(BIN)/granular-lmp collide jkr_pull_off --force \
	    --set contact.normal=$$law --set collision.normal_velocity=$$speed -o runs/pull_off/$${law}_$$speed || exit 1; done; done
	$(BIN)/granular-analysis pull_off $(foreach law,jkr dmt,$(SNAPS:%=runs/pull_off/$(law)_%)) -o figures/pull_off.png

# Where contacts of the paper's wave open and slide: docs/strongly-nonlinear.md. Wave numbers are 2πn/32
ENDS = $(BIN)/granular-lmp sweep tr_periodic --workers $(CORES) --set time.duration=60 --set packing.rows=32 \
    --set effects.contact_opening=true --set effects.friction=0.3
CLOSED = --set effects.sliding=false \
    --over wave.amplitude=0.1:0.5:5,0.7,0.9,1.1:2.9:37,3:5.5:26

onset: .venv/ready
	$(ENDS) $(CLOSED) -o runs/onset/plane --over sphere.poisson_ratio=0,0.17,0.45 --over wave.form=running,standing \
	    --over wave.wavenumber=0.3926990816987241:2.748893571891069:7
	$(ENDS) $(CLOSED) -o runs/onset/pulse --set packing.rows=auto --set packing.ends=fixed --set envelope.length=6 \
	    --over wave.wavenumber=0.7853981633974483:2.356194490192345:3
	$(ENDS) --set effects.sliding=true --set wave.amplitude=1 -o runs/onset/friction \
	    --over effects.friction=0.01,0.02,0.03,0.05,0.07,0.1,0.15,0.2,0.25,0.3,0.35,0.4,0.5,0.7,1
	$(BIN)/granular-analysis onset runs/onset/plane runs/onset/pulse runs/onset/friction -o figures/onset.png

# The same crystal by either law, from pairs of runs. The cell of 400 rows carries the wave numbers around both resonances,
# 2π·80/400 to 2π·97/400, and both antiresonances, 2π·133/400 to 2π·138/400 and 2π·159/400 to 2π·164/400
LAWS = $(SPECTRUM) --over sphere.adhesion_law=dmt,jkr

adhesion: .venv/ready
	$(BIN)/granular-lmp sweep tr_periodic $(LAWS) --set packing.rows=80 -o runs/adhesion/zone \
	    --over wave.wavenumber=0.1570796327:3.0630528372:38
	$(BIN)/granular-lmp sweep tr_periodic $(LAWS) --set packing.rows=400 -o runs/adhesion/close \
	    --over wave.wavenumber=1.2566370614:1.5236724369:18,2.0891591146:2.1676989309:6,2.4975661596:2.5761059759:6
	$(BIN)/granular-analysis adhesion_laws runs/adhesion/zone runs/adhesion/close -o figures/adhesion_laws.png

cost: .venv/ready
	$(BIN)/granular-lmp cost tr_nonresonant --repeats 9 -o runs/cost
	$(BIN)/granular-analysis accuracy runs/cost -o figures/accuracy.png

bench: .venv/ready
	-$(BIN)/granular-lmp build-kernel  # without a compiler it takes no part
	$(BIN)/python -m benchmarks -o figures/bench.png

scale: .venv/ready
	$(BIN)/python -m benchmarks.scale

decks: .venv/ready
	for scene in lammps_inputs/*/scene.toml lammps_inputs/impacts/*/scene.toml; do $(BIN)/granular-lmp build $$scene -o $$(dirname $$scene) --force || exit 1; done

# A warning is an error: a link, an anchor or a page of the navigation that is not there. The variable silences a notice of
# the theme's vendor about another program
docs: .venv/docs-ready
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# Each version keeps its folder; SITE=dev is that of the default branch; PUSH=--push sends gh-pages to its origin. The front
# door leads to the latest release
VERSION := $(shell sed -n 's/^__version__ = "\(.*\)"/\1/p' granular_lmp/__init__.py)
SITE ?= $(VERSION) latest
PUSH ?=

versioned-docs: .venv/docs-ready
	NO_MKDOCS_2_WARNING=1 $(BIN)/mike deploy $(PUSH) --update-aliases $(SITE)
	$(if $(filter latest,$(SITE)),$(BIN)/mike set-default $(PUSH) --allow-empty latest)

notebook: .venv/docs-ready
	$(BIN)/python docs/tutorial_notebook.py

rooms: .venv/ready
	$(BIN)/python docs/rooms.py

# Marker files, written last: an interrupted installation is repeated.
.venv/docs-ready: .venv/ready
	$(BIN)/python -m pip install --quiet --editable '.[docs]'
	touch $@

.venv/ready: pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or later is needed: make PYTHON=python3.12 ...") if sys.version_info < (3, 11) else None'
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --editable '.[test]'
	touch $@

clean:
	rm -rf runs/paper runs/effects runs/cost runs/spectrum runs/dispersion runs/waves runs/quiet runs/scattering runs/onset runs/adhesion runs/impact runs/published runs/pull_off runs/witness runs/disorder build dist site .venv .pytest_cache .mypy_cache .ruff_cache

# A sheet whose radii spread by 0.2 static overlaps
witness: .venv/ready
	$(BIN)/granular-lmp sweep tr_periodic -o runs/witness --force --over time.timestep=0.4,0.2,0.1,0.05 \
	    --set packing.rows=100 --set packing.columns=100 --set wave.wavenumber=0.8168140899 --set wave.amplitude=0.05 \
	    --set disorder.radius=5e-5 --set disorder.density=0.1 --set disorder.vacancies=0.01 \
	    --set time.duration=20 --set time.sample=10 --set output.particles=10
	$(BIN)/granular-analysis witness runs/witness -o figures/witness.png
	$(BIN)/python -m benchmarks.network
