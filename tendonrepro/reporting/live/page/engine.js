// One run of the comparison in time. MODELS, made from the package's own functions, holds all of its physics.
"use strict";

const STEPS = [1, 2, 3, 4, 5, 6, 8, 12, 16, 24, 32, 48, 64];
const RESOLVED = 2e-6; // rad: how far half the step may move a joint within one sample
const GROWN = 1e-3; // rad: the same in the last sample of a run that diverges, which moves far
const LOOKED_AT = 61; // the step is checked at every so many samples
const EXTREMES = ["q_d", "q", "e"], MEANS = ["s", "H_hat", "tau"];
const POINTS = 400; // stretches of samples that a curve is drawn by

// A job is {model, law, motion, pp, rr, turns, lag, from, n, L, steps, limit, ringing, share, exact}; see page.js.
function run(job) {
  const first = STEPS.findIndex((m) => m >= job.steps);
  for (const m of STEPS.slice(first)) {
    const found = runWith(job, m);
    if (job.exact ? found.resolution <= RESOLVED : found.resolution < Infinity) return found;
    if (m >= 24) return { ...found, status: "unresolved", mae: found.mae.fill(NaN), rmse: found.rmse.fill(NaN) };
  }
}

// A run as {found}, or why there is none as {failed}: an error would leave whoever asked waiting.
function attempt(job) {
  try {
    return { found: run(job) };
  } catch (error) {
    return { failed: String(error) };
  }
}

function runWith(job, steps) {
  const { n, L, pp, rr, turns, lag } = job, newest = -Math.expm1(-L / lag), late = new Float64Array(3 * n);
  const { plant, laws, motion } = MODELS[job.model], law = laws[job.law];
  const kp = new Float64Array(plant.constants), kl = new Float64Array(law.constants);
  const km = new Float64Array(motion.constants), cycles = new Float64Array(n), zz = new Float64Array(6 * n);
  const mm = new Float64Array(law.memory), oo = new Float64Array(law.memory + 6 * n + 1);
  plant.prepare(pp, rr, kp, zz);
  law.prepare(pp, zz, kl, mm);
  motion.prepare(pp, km, cycles);
  const samples = Math.floor((cycles[0] * turns[0].length) / L + 1e-6) + 1;
  const ss = zz.slice(0, 4 * n), dd = new Float64Array(3 * n), uu = new Float64Array(n + 2);
  const tt = new Float64Array(n), nn = new Float64Array(4 * n);
  const errors = Array.from({ length: n }, () => new Float64Array(samples));
  const curves = new Curves(n, samples, L);
  const before = new Float64Array(4 * n);
  let resolution = 0, done = samples, status = "ok";
  for (let k = 0; k < samples; k++) {
    desired(motion.run, km, cycles, turns, k * L, tt, dd);
    if (lag > 0) for (let i = n; i < 3 * n; i++) dd[i] = late[i] += newest * (dd[i] - late[i]);
    law.run(kl, ss, mm, dd, oo);
    const at = law.memory; // torque, encoder values, commanded and applied torque, estimate, surface, in bounds
    for (let i = 0; i < at; i++) mm[i] = oo[i];
    for (let i = 0; i < n; i++) errors[i][k] = dd[i] - oo[at + n + i];
    curves.add(k, dd, oo, at, errors);
    if (!(oo[at + 6 * n] > 0)) {
      done = k + 1;
      status = "diverged";
      // A step that is too long diverges by itself, and then half of it ends elsewhere.
      if (k > 0) {
        advance(plant.run, kp, before, nn, uu, (k - 1) * L, L, 2 * steps);
        if (!(furthest(before, ss, n) <= GROWN)) resolution = Infinity;
      }
      break;
    }
    if (k === samples - 1) break;
    for (let i = 0; i < n; i++) uu[i] = oo[at + i];
    const finer = job.exact && k % LOOKED_AT === 0 ? advance(plant.run, kp, ss.slice(), nn, uu, k * L, L, 2 * steps) : null;
    before.set(ss);
    advance(plant.run, kp, ss, nn, uu, k * L, L, steps);
    if (finer) resolution = Math.max(resolution, furthest(finer, ss, n));
  }
  const first = Math.max(0, Math.ceil(job.from / L - 0.5));
  const mae = errors.map((e) => mean(e, first, done, Math.abs));
  const rmse = errors.map((e) => Math.sqrt(mean(e, first, done, square)));
  if (status === "ok" && errors.some((e) => fastShare(e, L, job.ringing) > job.share)) status = "ringing";
  if (status === "diverged") mae.fill(NaN), rmse.fill(NaN);
  const end = (done - 1) * L;
  return { mae, rmse, status, end, duration: (samples - 1) * L, steps, resolution, curves: curves.held, stretch: curves.width };
}

// Desired motion at time t: joints follow their shape in turns, and stay where they are after the last.
function desired(shape, km, cycles, turns, t, tt, dd) {
  const n = turns.length, turn = (i) => Math.min(Math.max(Math.floor(t / cycles[i] + 1e-9), 0), turns[i].length - 1);
  for (let i = 0; i < n; i++) tt[i] = Math.min(Math.max(t - turn(i) * cycles[i], 0), cycles[i]);
  shape(km, tt, dd);
  for (let i = 0; i < n; i++) {
    const moves = turns[i][turn(i)];
    if (!moves) dd[i] = 0;
    if (!moves || t > cycles[i] * turns[i].length) dd[n + i] = dd[2 * n + i] = 0;
  }
}

// How far two states are apart on a joint; infinite where one has no number.
function furthest(a, b, n) {
  let most = 0;
  for (let i = 0; i < n; i++) {
    const apart = Math.abs(a[i] - b[i]);
    most = apart >= 0 ? Math.max(most, apart) : Infinity;
  }
  return most;
}

// Plant from one sample to the next, in so many Runge-Kutta steps; the torque is held.
function advance(step, kp, ss, nn, uu, t, L, steps) {
  const n = uu.length - 2, h = L / steps;
  uu[n + 1] = h;
  for (let j = 0; j < steps; j++) {
    uu[n] = t + j * h;
    step(kp, ss, uu, nn);
    ss.set(nn);
  }
  return ss;
}

const square = (x) => x * x;

function mean(values, first, end, of) {
  let sum = 0;
  for (let k = first; k < end; k++) sum += of(values[k]);
  return end > first ? sum / (end - first) : NaN;
}

// Share of a signal's power above a frequency, from the lines up to it; averages over blocks have them all.
function fastShare(x, L, frequency) {
  const block = Math.max(1, Math.floor(1 / (32 * frequency * L))), count = Math.floor(x.length / block) * block;
  const y = new Float64Array(count / block);
  let total = 0, slow = 0;
  for (let k = 0; k < count; k++) {
    total += x[k] * x[k];
    y[Math.floor(k / block)] += x[k];
  }
  const last = Math.min(Math.floor(frequency * (1 + 1e-9) * count * L), Math.floor(y.length / 2));
  for (let line = 0; line <= last; line++) {
    const turn = (2 * Math.PI * line) / y.length, half = (Math.PI * Math.max(line, 1e-9)) / count;
    const response = Math.sin(block * half) / (block * Math.sin(half)), c = Math.cos(turn), s = Math.sin(turn);
    let re = 0, im = 0, u = 1, v = 0;
    for (const value of y) {
      re += value * u;
      im += value * v;
      [u, v] = [u * c - v * s, u * s + v * c];
    }
    slow += ((line ? 2 : 1) * (re * re + im * im)) / (response * response) / count;
  }
  return total > 0 ? Math.max(1 - slow / total, 0) : 0;
}

// Curves for the eye, from stretches of samples. Of angles and errors the least and the largest value, so that
// nothing is lost. Of sliding variable, estimate and torque the mean: encoder counts make pulses that would hide it.
class Curves {
  constructor(n, samples, L) {
    this.n = n;
    this.samples = samples;
    this.size = Math.max(1, Math.ceil(samples / POINTS));
    this.width = this.size * L;
    this.low = new Float64Array(3 * n);
    this.high = new Float64Array(3 * n);
    this.lowFirst = new Uint8Array(3 * n);
    this.sum = new Float64Array(3 * n);
    this.held = { ends: [], middles: [] };
    for (const name of [...EXTREMES, ...MEANS]) this.held[name] = Array.from({ length: n }, () => []);
  }

  add(k, dd, oo, at, errors) {
    const { n, size, sum, held } = this, place = k % size;
    for (let i = 0; i < n; i++) {
      this.look(i, dd[i], place);
      this.look(n + i, oo[at + n + i], place);
      this.look(2 * n + i, errors[i][k], place);
      sum[i] += oo[at + 5 * n + i];
      sum[n + i] += oo[at + 4 * n + i];
      sum[2 * n + i] += oo[at + 3 * n + i];
    }
    if (place < size - 1 && k < this.samples - 1) return;
    const begin = Math.floor(k / size) * this.width;
    held.ends.push(begin, begin + this.width / 2);
    held.middles.push(begin + this.width / 2);
    for (let i = 0; i < n; i++) {
      EXTREMES.forEach((name, which) => {
        const m = which * n + i, pair = [this.low[m], this.high[m]];
        held[name][i].push(...(this.lowFirst[m] ? pair : pair.reverse()));
      });
      MEANS.forEach((name, which) => held[name][i].push(sum[which * n + i] / (place + 1)));
    }
    sum.fill(0);
  }

  look(m, value, place) {
    if (place === 0) this.low[m] = this.high[m] = value;
    else if (value < this.low[m]) {
      this.low[m] = value;
      this.lowFirst[m] = 0;
    } else if (value > this.high[m]) {
      this.high[m] = value;
      this.lowFirst[m] = 1;
    }
  }
}
