// The closed form of analysis/granular_analysis/second_harmonic.py, drawn for the values of a form. No library, no server.
// Equations and letters are those of that module and of docs/theory.md; tests/house/test_live.py compares the two.
"use strict";

const INERTIA = 0.4;  // I/(mR²) of a homogeneous sphere
const DURATION = 120;  // τ of the drawing
const COLORS = { p: "var(--live-p)", q: "var(--live-q)", φ: "var(--live-f)" };  // docs/site.css

// ---------------------------------------------------------------- theory

function ratiosOf(poissonRatio, overlapRatio) {
  const kappa = 2 * (1 - poissonRatio) / (2 - poissonRatio);
  const h = overlapRatio / (1 - overlapRatio), unit = 2 * kappa + 3;
  return {
    kappa, h,
    mu1: (3 * kappa + 1) / (kappa + 3),
    mu2: kappa / (kappa + 3),
    alpha: (2 * kappa - 1 + 2 * h * (1 - 5 * kappa)) / unit,
    beta: 2 * kappa * (1 - 6 * h) / unit,
    inertia: INERTIA / (1 - overlapRatio),
    longitudinal: 1 - 6 * h * (1 - kappa) / unit,
  };
}

// Frequency and amplitudes of a mode: p = P cos ϑ, q = Q cos ϑ, φ = −f sin ϑ
function modeOf(name, xi, { mu1, mu2, inertia }) {
  const s = Math.sin(xi / 2), c = Math.cos(xi);
  if (name === "L") return { name, xi, frequency: s, p: 1, q: 0, f: 0 };
  const A = mu1 * s ** 2, b = 2 * mu2 * (2 + c), c0 = Math.sqrt(3) * mu2 * Math.sin(xi);
  const d = (b - inertia * A) / 2, halfTrace = (b + inertia * A) / 2, r = Math.hypot(d, Math.sqrt(inertia) * c0);
  let squared, q, f;
  if (name === "RT") {
    squared = (halfTrace + r) / inertia;
    [q, f] = d >= 0 ? [inertia * c0, -(d + r)] : [r - d, -c0];
  } else {
    squared = 2 * mu2 * s ** 2 * (mu1 * (2 + c) - 3 * mu2 * (1 + c)) / (halfTrace + r);
    [q, f] = d >= 0 ? [d + r, c0] : [inertia * c0, r - d];
  }
  const norm = Math.hypot(q, f);
  return { name, xi, frequency: Math.sqrt(squared), p: 0, q: q / norm, f: f / norm };
}

function sourceOf(mode, ratios) {
  const s = Math.sin(mode.xi / 2);
  if (mode.name === "L") return -ratios.longitudinal * s ** 2;
  return mode.q * (ratios.alpha * s ** 2 * mode.q - ratios.beta / Math.sqrt(3) * Math.sin(mode.xi) * mode.f);
}

// P̃1/i: the wave that runs along with the fundamental, per ε and for complex fields
function generatedAmplitude(mode, ratios) {
  if (mode.name === "L") return ratios.longitudinal / Math.tan(mode.xi / 2) / 2;
  const w = Math.sin(mode.xi);
  return w * sourceOf(mode, ratios) / ((w - 2 * mode.frequency) * (w + 2 * mode.frequency));
}

// ∫₀^τ e^{ixt} dt = τ e^{ixτ/2} sin(xτ/2)/(xτ/2), as [real, imaginary] part
function phaseIntegral(x, tau) {
  const half = x * tau / 2, size = tau * (half ? Math.sin(half) / half : 1);
  return [size * Math.cos(half), size * Math.sin(half)];
}

// p, q, φ of the sphere at the middle of the strip (row 0), in units of the amplitude D0
function motion(mode, ratios, amplitude, tau) {
  const w = Math.sin(mode.xi), twice = 2 * mode.frequency, theta = -mode.frequency * tau;
  const epsilon = -Math.sqrt(3) * amplitude * (2 * ratios.kappa + 3) / (4 * (ratios.kappa + 3));
  const [br, bi] = phaseIntegral(-w - twice, tau), [fr, fi] = phaseIntegral(w - twice, tau);
  const cos = Math.cos(w * tau), sin = Math.sin(w * tau);
  const harmonic = epsilon / 4 * sourceOf(mode, ratios) * (cos * br - sin * bi - (cos * fr + sin * fi));
  return { p: mode.p * Math.cos(theta) + harmonic, q: mode.q * Math.cos(theta), φ: -mode.f * Math.sin(theta) };
}

// Wave number of TR at which its second harmonic is a free L wave: the least root of a cubic in C = cos ξ
function resonanceOf({ mu1, mu2, inertia }) {
  const above = C => (2 * mu2 * (2 + C) - inertia * (1 - C ** 2) / 4) * (mu1 - (1 + C) / 2) / 2 - 3 * mu2 ** 2 * (1 + C) > 0;
  let low = -1, high = -1;
  while (above(high)) [low, high] = [high, high + 0.005];
  for (let i = 0; i < 60; i++) {
    const middle = (low + high) / 2;
    if (above(middle)) low = middle; else high = middle;
  }
  return Math.acos(low);
}

// Wave number at which TR makes no p at order ε; null where there is none
function antiresonanceOf({ mu1, mu2, alpha, beta, inertia }) {
  const rho = alpha / beta, rate = mu1 - 3 * mu2 * rho, inertial = inertia * rate * rho / 2;
  const numerator = 2 * mu2 * (1 - 2 * rho) + inertial, denominator = 2 * mu2 * (rho - 1) + inertial;
  return rate <= 0 || rho <= 0 || Math.abs(numerator) >= Math.abs(denominator) ? null : Math.acos(numerator / denominator);
}

// ---------------------------------------------------------------- spheres, in SI units

// Equal spheres of a DMT contact at rest, as granular_lmp/crystal/sphere.py has them
function sphereOf({ modulus, nu, density, radius, adhesion, force }) {
  const R = radius * 1e-6, coefficient = 4 / 3 * modulus * 1e9 / (2 * (1 - nu ** 2)) * Math.sqrt(R / 2);
  const overlap = ((2 * Math.PI * adhesion * R / 2 + force) / coefficient) ** (2 / 3);
  const stiffness = 1.5 * coefficient * Math.sqrt(overlap), kappa = 2 * (1 - nu) / (2 - nu);
  const mass = 4 / 3 * Math.PI * R ** 3 * density;
  return {
    overlap, stiffness, ratio: overlap / (2 * R), time: Math.sqrt(mass / (2 * (kappa + 3) * stiffness)),
    row: Math.sqrt(3) / 2 * (2 * R - overlap),
  };
}

// ---------------------------------------------------------------- what is typed

// Name of a field, what it is, and its limits; both limits are allowed
const FIELDS = [
  ["xi", "wave number ξ", 0.01, 3.14], ["a", "amplitude a", 1e-6, 1], ["nu", "Poisson's ratio ν", -0.99, 0.5],
  ["modulus", "Young's modulus", 1e-6, 1e4], ["density", "density", 1, 1e5], ["radius", "radius", 1e-3, 1e6],
  ["adhesion", "work of adhesion", 0, 1e3], ["force", "pressing force", 0, 1e6],
];

function numbersOf(typed) {
  const values = {};
  for (const [name, words, low, high] of FIELDS) {
    const text = String(typed[name]).trim(), value = Number(text);
    if (!text || !Number.isFinite(value)) throw Error(`${words}: "${text}" is no number; write one as 0.2 or 2e-1`);
    if (value < low || value > high) throw Error(`${words} = ${value}: must be from ${low} to ${high}`);
    values[name] = value;
  }
  return values;
}

// All that the page shows of what is typed; an Error says what is wrong with it
function answerOf(typed) {
  const modes = ["TR", "RT", "L"], geometries = ["paper", "lammps"];
  if (!modes.includes(typed.mode)) throw Error(`wave = "${typed.mode ?? ""}": must be one of ${modes.join(", ")}`);
  if (!geometries.includes(typed.geometry)) throw Error(`points of contact = "${typed.geometry ?? ""}": must be one of ${geometries.join(", ")}`);
  const values = numbersOf(typed), sphere = sphereOf(values), lammps = typed.geometry === "lammps";
  if (!(sphere.overlap > 0)) throw Error("work of adhesion and pressing force are both 0: nothing holds the contacts");
  if (sphere.ratio > 0.1) throw Error(`the overlap at rest is ${Math.round(100 * sphere.ratio)} % of a diameter: must be at most 10 %`);
  if (lammps && values.force) throw Error("points of contact of LAMMPS: need a pressing force of 0, which makes the crystal softer across");
  const ratios = ratiosOf(values.nu, lammps ? sphere.ratio : 0), mode = modeOf(typed.mode, values.xi, ratios);
  const named = { resonance: resonanceOf(ratios), antiresonance: antiresonanceOf(ratios) };
  const special = Object.entries(named).filter(([, xi]) => xi).map(([name, xi]) => [name, modeOf("TR", xi, ratios)]);
  return {
    ...values, sphere, ratios, mode, generated: generatedAmplitude(mode, ratios),
    waves: [[typed.mode, mode], ...special].map(([name, wave]) => ({
      name, xi: wave.xi, frequency: wave.frequency, hertz: wave.frequency / (2 * Math.PI * sphere.time),
      length: 2 * Math.PI / wave.xi * sphere.row,
    })),
    at: [7, 60, 120].map(tau => motion(mode, ratios, values.a, tau)),
  };
}

function inSI(value, unit) {
  const power = Math.max(-5, Math.min(4, Math.floor(Math.log10(value * (1 + 1e-12)) / 3)));
  return `${Number((value / 1000 ** power).toPrecision(4))} ${["f", "p", "n", "µ", "m", "", "k", "M", "G", "T"][power + 5]}${unit}`;
}

// ---------------------------------------------------------------- drawing

const HEIGHT = 260, LEFT = 58, BOTTOM = 36, TOP = 10, RIGHT = 18;
let WIDTH = 640;  // pixels, fewer on a telephone: letters keep their size

// An SVG with axes, and one path per curve; curves are lists of [x, y] in data units, null parts a path
function drawn({ x, y, xTicks, yTicks, xLabel, yLabel, curves, marks }) {
  const across = v => LEFT + (v - x[0]) / (x[1] - x[0]) * (WIDTH - LEFT - RIGHT);
  const up = v => HEIGHT - BOTTOM - (v - y[0]) / (y[1] - y[0]) * (HEIGHT - BOTTOM - TOP);
  const text = (at, height, anchor, words, more = "") =>
    `<text x="${at}" y="${height}" text-anchor="${anchor}" ${more}>${words}</text>`;
  const path = points => points.map((point, i) =>
    point ? `${i && points[i - 1] ? "L" : "M"}${across(point[0]).toFixed(1)} ${up(point[1]).toFixed(1)}` : "").join("");
  return `<svg viewBox="0 0 ${WIDTH} ${HEIGHT}" role="img" aria-label="${yLabel} over ${xLabel}">`
    + xTicks.map(([v, label]) => `<path class="grid" d="M${across(v)} ${TOP}V${HEIGHT - BOTTOM}"/>`
      + text(across(v), HEIGHT - BOTTOM + 15, "middle", label)).join("")
    + yTicks.map(([v, label]) => `<path class="grid" d="M${LEFT} ${up(v)}H${WIDTH - RIGHT}"/>`
      + text(LEFT - 6, up(v) + 4, "end", label)).join("")
    + text((LEFT + WIDTH) / 2, HEIGHT - 4, "middle", xLabel)
    + text(0, 0, "middle", yLabel, `transform="translate(12 ${(HEIGHT - BOTTOM) / 2}) rotate(-90)"`)
    + marks.map(v => `<path class="mark" d="M${across(v)} ${TOP}V${HEIGHT - BOTTOM}"/>`).join("")
    + curves.map(({ points, color, dash }) =>
      `<path class="curve" style="stroke:${color};stroke-dasharray:${dash || "none"}" d="${path(points)}"/>`).join("")
    + "</svg>";
}

function ticks(limit) {  // five of them, round, from −limit to limit
  const step = [1, 2, 5, 10].map(m => m * 10 ** Math.floor(Math.log10(limit / 2))).find(s => limit / s <= 3);
  return Array.from({ length: 7 }, (_, i) => (i - 3) * step).filter(v => Math.abs(v) <= limit)
    .map(v => [v, v === 0 ? "0" : Number(v.toPrecision(1))]);
}

function signals(mode, ratios, amplitude, names) {
  const times = Array.from({ length: 1201 }, (_, i) => i * DURATION / 1200);
  const all = times.map(tau => motion(mode, ratios, amplitude, tau));
  const limit = 1.08 * (Math.max(...all.flatMap(at => names.map(name => Math.abs(at[name])))) || 1);
  return drawn({
    x: [0, DURATION], y: [-limit, limit], xLabel: "time τ", yLabel: `${names.join(", ")} in D₀`, marks: [],
    xTicks: [0, 20, 40, 60, 80, 100, 120].map(v => [v, v]), yTicks: ticks(limit),
    curves: names.map(name => ({ color: COLORS[name], points: all.map((at, i) => [times[i], at[name]]) })),
  });
}

function spectrum(ratios, xi) {
  const low = -3, high = 2;  // decades
  const curve = name => Array.from({ length: 900 }, (_, i) => {
    const at = 0.02 + (Math.PI - 0.04) * i / 899;
    const size = Math.log10(Math.abs(generatedAmplitude(modeOf(name, at, ratios), ratios)));
    return size < low ? null : [at, Math.min(high, size)];
  });
  return drawn({
    x: [0, Math.PI], y: [low, high], xLabel: "wave number ξ, rad per row", yLabel: "|P̃₁|", marks: [xi],
    xTicks: [0, 0.5, 1, 1.5, 2, 2.5, 3].map(v => [v, v]),
    yTicks: [-3, -2, -1, 0, 1, 2].map(v => [v, `10${[..."⁻³ ⁻² ⁻¹ ⁰ ¹ ²".split(" ")][v + 3]}`]),
    curves: [["TR", COLORS.p], ["RT", COLORS.q, "6 3"], ["L", COLORS["φ"], "2 3"]]
      .map(([name, color, dash]) => ({ color, dash, points: curve(name) })),
  });
}

// ---------------------------------------------------------------- page

function rowsOf({ waves, sphere, a, mode, generated }) {
  const rows = waves.map(({ name, xi, frequency, hertz, length }) =>
    [name, `ξ = ${xi.toFixed(4)}, Ω = ${frequency.toFixed(4)}`, `${inSI(hertz, "Hz")}, wavelength ${inSI(length, "m")}`]);
  const size = Math.abs(generated) < 1e4 ? generated.toPrecision(4) : "±∞";
  return [
    ...rows, ["D₀", `a = ${a}`, inSI(a * sphere.overlap, "m")],
    ["contact at rest", "Δ₀, k₁", `${inSI(sphere.overlap, "m")}, ${inSI(sphere.stiffness, "N/m")}`],
    ["unit of time", "t₀", inSI(sphere.time, "s")],
    ["Q, f, P̃₁/i", [mode.q.toFixed(4), mode.f.toFixed(4), size].join(", "), ""],
  ];
}

function start(form) {
  const at = name => form.elements[name], part = name => document.getElementById(`live-${name}`);
  const sliders = [...form.querySelectorAll("input[type=range]")];
  for (const [name, value] of new URLSearchParams(location.hash.slice(1))) if (at(name)) at(name).value = value;

  function redraw() {
    let found;
    const shown = ["numbers", "shape", "harmonic", "spectrum"].map(part);
    try {
      found = answerOf(Object.fromEntries(new FormData(form)));
    } catch (wrong) {
      part("wrong").textContent = wrong.message;
      for (const each of shown) each.style.opacity = 0.2;  // they belong to the values before
      return;
    }
    part("wrong").textContent = "";
    for (const each of shown) each.style.opacity = 1;
    const { mode, ratios, a } = found;
    for (const slider of sliders) slider.value = found[slider.dataset.of];
    WIDTH = Math.max(300, Math.min(640, part("spectrum").clientWidth));
    part("numbers").innerHTML = rowsOf(found).map(cells => `<tr><td>${cells.join("</td><td>")}</td></tr>`).join("");
    part("shape").innerHTML = signals(mode, ratios, a, mode.name === "L" ? ["p"] : ["q", "φ"]);
    part("harmonic").innerHTML = signals(mode, ratios, a, ["p"]);
    part("harmonic").hidden = mode.name === "L";
    part("spectrum").innerHTML = spectrum(ratios, mode.xi);
    form.dataset.motion = JSON.stringify(found);
    history.replaceState(null, "", `#${new URLSearchParams(new FormData(form))}`);
  }

  form.addEventListener("input", event => {
    if (event.target.dataset?.of) at(event.target.dataset.of).value = event.target.value;
    redraw();
  });
  redraw();
}

if (typeof document !== "undefined") start(document.getElementById("live"));
