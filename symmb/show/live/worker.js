"use strict";
// Runs and bounds of a live page. A study has a nominal run, bounds from runs at the nodes of one level after another, and the
// effects of single parameters. A new study ends an older one, because each run gives way to messages.

let live, wasm, surrogate, started, latest = 0;
const give = (message, ...moved) => postMessage(message, moved.map(each => each.buffer));
const channel = new MessageChannel(), waiting = [];
channel.port1.onmessage = () => waiting.shift()();
let free = 0;  // when messages could arrive for the last time
const others = () => performance.now() - free < 4 ? null : new Promise(go => {
  waiting.push(() => { free = performance.now(); go(); });
  channel.port2.postMessage(0);
});

onmessage = async ({ data }) => {
  try {
    if (data.kind === "start") await (started = start(data.live));
    else if (data.id > latest) {
      latest = data.id;
      await started;
      if (data.id === latest) await study(data);
    }
  } catch (error) {
    if (!(error instanceof Ended)) give({ kind: "fault", id: data.id, fault: String(error.message ?? error) });
  }
};

class Ended extends Error {}  // by a newer study

async function start(given) {
  live = given;
  const module = await WebAssembly.compile(await unpacked(live.wasm)), imports = {};
  for (const { module: from, name } of WebAssembly.Module.imports(module)) (imports[from] ??= {})[name] = () => 52;  // no system
  wasm = (await WebAssembly.instantiate(module, imports)).exports;
  wasm._initialize?.();
  if (live.surrogate) {
    const numbers = await unpacked(live.surrogate.numbers), { parts } = live.surrogate, m = live.n_t * live.n_y;
    let at = 8 * m * parts.length;
    const next = count => { const own = new Float32Array(numbers, at, count); at += own.byteLength; return own; };
    surrogate = { error: next(m), parts: parts.map((part, k) => ({ ...part, constants: new Float64Array(numbers, 8 * m * k, m),
                                                                  terms: next((part.degrees.length - 1) * m) })) };
  }
  give({ kind: "ready" });
}

async function unpacked(text) {
  const packed = new Blob([Uint8Array.from(atob(text), c => c.charCodeAt(0))]);
  return new Response(packed.stream().pipeThrough(new DecompressionStream("deflate"))).arrayBuffer();
}

// Memory: parts of one room, given by numbers of doubles
function rooms(...sizes) {
  const begin = wasm.room(sizes.reduce((sum, size) => sum + size, 0));
  if (!begin) throw Error("There is not enough memory.");
  let at = begin;
  return sizes.map(size => { const own = at; at += 8 * size; return own; });
}
const view = (at, count) => new Float64Array(wasm.memory.buffer, at, count);

function text(at) {
  const bytes = new Uint8Array(wasm.memory.buffer, at);
  return new TextDecoder().decode(bytes.slice(0, bytes.indexOf(0)));
}

function partAt(parameters) {  // the part of the box of a surrogate that contains the parameters
  const distance = ({ centre, half }) => Math.max(...parameters.map((value, k) => Math.abs(value - centre[k]) / half[k]));
  return surrogate.parts.reduce((best, part) => distance(part) < distance(best) ? part : best);
}

function evaluate(parameters, at, part = partAt(parameters)) {  // the polynomials of a part
  const { centre, half, degrees, constants, terms } = part, m = constants.length, rows = view(at, m);
  const legendre = parameters.map((value, k) => {
    const x = (value - centre[k]) / half[k], P = [1, x], most = Math.max(...degrees.map(own => own[k]));
    for (let j = 1; j < most; j++) P.push(((2 * j + 1) * x * P[j] - j * P[j - 1]) / (j + 1));
    return P;
  });
  rows.set(constants);
  degrees.slice(1).forEach((own, b) => {
    const factor = own.reduce((product, degree, k) => product * legendre[k][degree], 1);
    for (let i = 0; i < m; i++) rows[i] += factor * terms[b * m + i];
  });
  return { finished: live.n_t, fault: null };
}

function run(parameters, columns, at, p) {  // rows of the first columns, to a place in memory
  if (surrogate) return evaluate(parameters, at);
  view(p, parameters.length).set(parameters);
  const finished = wasm.run(p, columns, at);
  if (finished < live.n_t) view(at + 8 * finished * columns, (live.n_t - finished) * columns).fill(NaN);
  return { finished, fault: finished < live.n_t ? text(wasm.fault()) : null };
}

async function study({ id, values, tolerances, limits }) {
  const began = performance.now(), { n_t, n_y, n_out } = live, m = n_t * n_y, nominal = [...values, ...live.inputs];
  const varied = tolerances.flatMap((tolerance, i) => tolerance > 0 ? [i] : []), d = varied.length;
  const sizes = [...live.levels[d - 1] ?? []];
  while (sizes.length > 1 && sizes.at(-1) * m > 12e6) sizes.pop();  // memory of 100 MB
  const n = sizes.at(-1) ?? 1, few = 100;  // few responses at a time, because messages wait for their bounds
  const turn = async () => { await others(); if (id !== latest) throw new Ended(); };
  const inParts = surrogate?.parts.length > 1, homes = { low: [], high: [] };
  const [p, rows, found, points, some, scaled, Y, Z] =
    rooms(nominal.length, n_t * n_out, 2 * few, 2 * few * d, n * few, n * few, n * m, inParts ? n * m : 0);
  const full = parameters => {
    const { finished, fault } = run(parameters, n_out, rows, p);
    return { rows: view(rows, n_t * n_out).slice(), finished, fault };
  };
  const first = full(nominal);
  give({ kind: "run", id, ...first, rows: first.rows.slice(), ms: performance.now() - began });
  if (first.fault) return;
  if (d > live.most_varied) throw Error(`At most ${live.most_varied} parameters may have tolerances at the same time. Hold some of them.`);
  const at = point => { const all = [...nominal]; varied.forEach((i, k) => { all[i] += tolerances[i] * point[k]; }); return all; };
  const firstLevel = live.levels.slice(0, d - 1).reduce((sum, own) => sum + own.length, 0);
  // How far a peak or a kink may pass the value at an output time, until the next output time
  const between = (bound, i) => i < n_y || i + n_y >= m ? 0 : Math.abs(bound[i - n_y] - 2 * bound[i] + bound[i + n_y]) / 2;
  const closest = (lower, upper, error, level) => limits.map(limit => {
    let best = { margin: Infinity, side: limit.low === null ? "high" : "low", time: 0 };
    for (let k = 0; k < n_t; k++)
      for (const side of ["low", "high"]) {
        if (limit[side] === null) continue;
        const i = k * n_y + limit.output, margin = side === "low" ? lower[i] - limit.low : limit.high - upper[i];
        if (margin < best.margin) {
          const bound = side === "low" ? lower : upper;
          best = { margin, side, time: k, value: bound[i], error: error[i] + between(bound, i) };
        }
      }
    let parameters = nominal;
    if (d) {
      const i = best.time * n_y + limit.output, home = homes[best.side][i];
      if (home) fill(home, level);
      wasm.bounds(level, m, 1, (home ? Z : Y) + 8 * i, found, points);
      parameters = (home?.at ?? at)([...view(points + (best.side === "low" ? 0 : 8 * d), d)]);
    }
    return { ...limit, ...best, parameters: parameters.slice(0, values.length), all: parameters };
  });
  const finish = ({ all, ...told }) => ({ ...told, rows: full(all).rows });  // with the run of the worst case

  if (!d) {
    const y = new Float64Array(m);
    for (let k = 0; k < n_t; k++) y.set(first.rows.subarray(k * n_out, k * n_out + n_y), k * n_y);
    const error = surrogate ? Float64Array.from(surrogate.error) : new Float64Array(m), told = closest(y, y, error, 0).map(finish);
    give({ kind: "bounds", id, runs: 1, lower: y, upper: y.slice(), error, done: true, ms: performance.now() - began, limits: told });
    give({ kind: "effects", id, widths: new Float64Array(n_y * values.length),
           limits: limits.map(() => ({ widths: values.map(() => 0), factor: null })) });
    return;
  }
  let before = null, told = [], level = firstLevel;
  for (let l = 0, runs = 0; l < sizes.length; l++) {
    level = firstLevel + l;
    for (; runs < sizes[l]; runs++) {
      await turn();
      const { fault } = run(at(varied.map((_, k) => wasm.node(level, runs, k))), n_y, Y + 8 * runs * m, p);
      if (fault) {
        give({ kind: "bounds", id, done: true, ms: performance.now() - began, fault });
        return;
      }
    }
    if (l < sizes.length - 2 && performance.now() - began < 40) continue;  // better bounds follow at once
    const [lower, upper] = await (inParts ? boundsInParts(level) : boundsOf(level, m, m, Y)), error = new Float64Array(m).fill(Infinity);
    for (let i = 0; i < m; i++) {  // polynomials may leave the range of possible values
      const [low, high] = live.possible[i % n_y];
      for (const ends of [lower, upper]) ends[i] = Math.min(Math.max(ends[i], low ?? -Infinity), high ?? Infinity);
    }
    for (let i = 0; before && i < m; i++)
      error[i] = Math.max(Math.abs(lower[i] - before.lower[i]), Math.abs(upper[i] - before.upper[i])) + (surrogate?.error[i] ?? 0);
    before = { lower: lower.slice(), upper: upper.slice() };
    const done = l === sizes.length - 1;
    told = closest(lower, upper, error, level);
    give({ kind: "bounds", id, runs, lower, upper, error, done, ms: performance.now() - began, limits: told.map(finish) }, lower, upper, error);
  }
  await turn();
  give({ kind: "effects", id, ...await effects(), memory: wasm.memory.buffer.byteLength });

  async function boundsOf(level, stride, m, from) {
    const lower = new Float64Array(m), upper = new Float64Array(m);
    for (let i = 0; i < m; i += few) {
      const count = Math.min(few, m - i);
      if (!wasm.bounds(level, stride, count, from + 8 * i, found, points)) throw Error("There is not enough memory.");
      lower.set(view(found, count), i);
      upper.set(view(found + 8 * count, count), i);
      await turn();
    }
    return [lower, upper];
  }

  // The polynomials of neighbouring parts of a surrogate meet at kinks or jumps, so each part has bounds of its own
  function partsOf(factor) {  // the parts that a box of the tolerances times a factor intersects
    const size = i => factor * tolerances[i];
    return surrogate.parts.flatMap(part => {
      const low = values.map((value, i) => Math.max(value - size(i), part.centre[i] - part.half[i]));
      const high = values.map((value, i) => Math.min(value + size(i), part.centre[i] + part.half[i]));
      const at = point => { const all = [...low]; varied.forEach((i, k) => { all[i] = low[i] + (point[k] + 1) / 2 * (high[i] - low[i]); }); return all; };
      return low.every((end, i) => tolerances[i] ? end < high[i] : end <= high[i]) ? [{ part, at }] : [];
    });
  }

  function fill({ part, at }, level) {  // values at the nodes of a part
    for (let j = 0; j < sizes[level - firstLevel]; j++) evaluate(at(varied.map((_, k) => wasm.node(level, j, k))), Z + 8 * j * m, part);
  }

  async function boundsInParts(level) {
    const ends = [new Float64Array(m).fill(Infinity), new Float64Array(m).fill(-Infinity)];
    for (const home of partsOf(1)) {
      fill(home, level);
      const [lower, upper] = await boundsOf(level, m, m, Z);
      for (let i = 0; i < m; i++) {
        if (lower[i] < ends[0][i]) [ends[0][i], homes.low[i]] = [lower[i], home];
        if (upper[i] > ends[1][i]) [ends[1][i], homes.high[i]] = [upper[i], home];
      }
    }
    return ends;
  }

  async function effects() {  // the polynomials along one parameter interpolate the nodes on its axis
    const l = sizes.length - 1, widths = new Float64Array(n_y * values.length), ofLimits = limits.map(() => values.map(() => 0));
    const line = live.levels[0].findIndex(count => count === live.axes[d - 1][l][0].length);
    for (let k = 0; k < d; k++) {
      const along = live.axes[d - 1][l][k], ends = { low: new Float64Array(m), high: new Float64Array(m) };
      for (let i = 0; i < m; i += few) {
        const count = Math.min(few, m - i);
        along.forEach((row, j) => view(some + 8 * j * count, count).set(view(Y + 8 * (row * m + i), count)));
        const [lower, upper] = await boundsOf(line, count, count, some);
        ends.low.set(lower, i);
        ends.high.set(upper, i);
      }
      for (let i = 0; i < m; i++) {
        const of = (i % n_y) * values.length + varied[k];
        widths[of] = Math.max(widths[of], ends.high[i] - ends.low[i]);
      }
      told.forEach((limit, j) => {  // only a change towards the limit counts
        const i = limit.time * n_y + limit.output;
        ofLimits[j][varied[k]] = Math.abs(ends[limit.side][i] - view(Y, m)[i]);
      });
    }
    const factors = [];
    for (const limit of told) factors.push(await factorOf(limit));
    return { widths, limits: ofLimits.map((own, j) => ({ widths: own, factor: factors[j] })) };
  }

  async function factorOf(limit) {  // bisection over the times at which the limit would be reached first
    const middle = k => view(Y, m)[k * n_y + limit.output], ends = before;
    const nearest = k => Math.max(
      limit.low === null ? 0 : (middle(k) - ends.lower[k * n_y + limit.output]) / (middle(k) - limit.low),
      limit.high === null ? 0 : (ends.upper[k * n_y + limit.output] - middle(k)) / (limit.high - middle(k)));
    const times = Array.from({ length: n_t }, (_, k) => k);
    if (times.some(k => limit.low !== null && middle(k) < limit.low || limit.high !== null && middle(k) > limit.high)) return 0;
    const chosen = times.sort((a, b) => nearest(b) - nearest(a)).slice(0, 25), count = chosen.length;
    const gather = from => {  // of the chosen times
      const all = view(from, n * m), to = view(some, n * count);
      for (let j = 0; j < n; j++) chosen.forEach((k, r) => { to[j * count + r] = all[j * m + k * n_y + limit.output]; });
    };
    const isKept = async from => {
      const [lower, upper] = await boundsOf(level, count, count, from);
      return (limit.low === null || lower.every(y => y >= limit.low)) && (limit.high === null || upper.every(y => y <= limit.high));
    };
    const kept = async factor => {
      for (const part of inParts ? partsOf(factor) : []) {
        fill(part, level);
        gather(Z);
        if (!await isKept(some)) return false;
      }
      if (inParts) return true;
      gather(Y);
      if (!wasm.scaled(level, count, count, some, factor, scaled)) throw Error("There is not enough memory.");
      return isKept(scaled);
    };
    const room = i => Math.min(values[i] - live.parameters[i].low, live.parameters[i].high - values[i]);
    let low = 0, high = surrogate ? Math.min(3, ...varied.map(i => room(i) / tolerances[i])) : 3;
    if (await kept(high)) return null;
    while (high - low > 2e-3 * high && high > 1e-3) {
      const middle = (low + high) / 2;
      if (await kept(middle)) low = middle; else high = middle;
    }
    return low || high;
  }
}
