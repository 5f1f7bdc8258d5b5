// The closed form of analysis/granular_analysis/second_harmonic.py, drawn for the values of the sliders. No library, no server.
// Equations and letters are those of that module and of docs/theory.md; tests/house/test_browser.py compares the two.
"use strict";

const INERTIA = 0.4;  // I/(mR²) of a homogeneous sphere
const DURATION = 120;  // τ of the drawing
const COLORS = { p: "#b5413a", q: "#2f6fa7", φ: "#6a8f3c" };

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

// ---------------------------------------------------------------- drawing

const WIDTH = 640, HEIGHT = 260, LEFT = 58, BOTTOM = 36, TOP = 10, RIGHT = 18;

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
    x: [0, DURATION], y: [-limit, limit], xLabel: "time τ", yLabel: `${names.join(", ")} in D0`, marks: [],
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

function start(form) {
  const at = name => form.elements[name], part = name => document.getElementById(`live-${name}`);
  for (const [name, value] of new URLSearchParams(location.hash.slice(1))) if (at(name)) at(name).value = value;

  function redraw() {
    const [xi, nu, a, eta] = ["xi", "nu", "a", "eta"].map(name => Number(at(name).value));
    const ratios = ratiosOf(nu, eta), mode = modeOf(at("mode").value, xi, ratios);
    const generated = generatedAmplitude(mode, ratios);
    for (const name of ["xi", "nu", "a"]) part(name).textContent = Number(at(name).value).toFixed(name === "xi" ? 3 : 2);
    part("shape").innerHTML = signals(mode, ratios, a, mode.name === "L" ? ["p"] : ["q", "φ"]);
    part("harmonic").innerHTML = signals(mode, ratios, a, ["p"]);
    part("harmonic").hidden = mode.name === "L";
    part("spectrum").innerHTML = spectrum(ratios, xi);
    part("numbers").textContent = `Ω = ${mode.frequency.toFixed(6)}   Q = ${mode.q.toFixed(6)}   f = ${mode.f.toFixed(6)}   `
      + `P̃₁/i = ${Math.abs(generated) < 1e4 ? generated.toPrecision(6) : "±∞ (resonance)"}`;
    form.dataset.motion = JSON.stringify({ ...mode, generated, at: [7, 60, 120].map(tau => motion(mode, ratios, a, tau)) });
    history.replaceState(null, "", `#${new URLSearchParams(new FormData(form))}`);
  }

  form.addEventListener("input", redraw);
  redraw();
}

start(document.getElementById("live"));
