"use strict";
// Panel of a live page: parameters, tolerances and limits. The worker computes; this script states what it has found.
//
// A move starts a study with a number of its own. Answers to older studies are dropped, so the last move wins.
// Texts of a scene enter the page as text only, never as HTML.

window.live = (() => {
  const { live } = page, { parameters, outputs, limits, n_t, n_y, n_out } = live;
  const digits = x => +x.toPrecision(12), shareOf = ({ value, tolerance }) => digits(100 * tolerance / Math.abs(value));
  const original = parameters.map(({ value, tolerance, in_percent }, i) =>
    changed(i, {}, { value, tolerance, percent: in_percent ? shareOf({ value, tolerance }) : null, held: false }));
  const state = [...original];  // a tolerance in percent follows the value; a parameter that is held has no tolerance
  const waiting = [];  // promises of studies that are not finished
  let id = 0, focus = 0, chosen = false, going = false, run = null, bounds = null, effects = null, fault = null;
  let fitted = 0, planned = 0, saving = 0, took = { run: null, bounds: null };

  const element = (tag, properties, ...children) => {
    const made = Object.assign(document.createElement(tag), properties);
    made.append(...children);
    return made;
  };
  const tell = (node, text) => {  // a text keeps the height of the text before, so that no slider moves under a pointer
    if (node.textContent === text) return;
    node.style.minHeight = `${node.offsetHeight}px`;
    node.textContent = text;
  };
  const withUnit = (text, unit) => `${text}${unit && `\u00a0${unit}`}`, quantity = (value, unit) => withUnit(short(value), unit);
  // Isolated, so that a name in Arabic or Hebrew does not reverse the signs and numbers beside it
  const brief = text => `\u2068${text.length > 60 ? `${text.slice(0, 59)}…` : text}\u2069`;
  const at = k => `${+live.times[k].toPrecision(6)}\u00a0s`;
  const within = (value, size) =>  // a value with the digits that its tolerance needs
    +value.toPrecision(Math.min(Math.max(3 + Math.ceil(Math.log10(Math.abs(value) / size)), 4), 12));
  const when = ({ output }, k) => outputs[output].scalar ? "" : ` at ${at(k)}`;  // a scalar output is the same at all times
  const limitText = ({ output, low, high }) => {
    const { name, unit } = outputs[output], end = value => value === null ? [] : [withUnit(digits(value), unit)];
    return [...end(low), brief(name), ...end(high)].join(" ≤ ");
  };
  const outputAt = () => limits[focus]?.output ?? focus - limits.length;  // the focus is on a limit, or after them an output

  // Numbers of the drawing: those of run 0 (nominal) or 1 (worst case), from the rows of a run
  function write(which, rows) {
    for (const { at, rows: count, column, width } of live.columns)
      for (let k = 0; k < count; k++)
        for (let j = 0; j < width; j++) numbers[at[which] + k * width + j] = rows[live.pictures[k] * n_out + column + j];
  }

  function writeBounds() {
    for (const side of ["lower", "upper"])
      live.pictures.forEach((time, k) => {
        const from = time * n_y, to = page.bounds[side][0] + k * n_y;
        if (bounds?.[side]) numbers.set(bounds[side].subarray(from, from + n_y), to);
        else numbers.fill(NaN, to, to + n_y);
      });
  }

  // Verdicts: a run beyond a limit violates it; bounds inside the limit by more than their error satisfy it
  function excess(limit, rows) {  // the largest distance beyond a limit, and its time
    let most = { by: 0, time: null };
    for (let k = 0; rows && k < n_t; k++) {
      const y = rows[k * n_out + limit.output];
      const unsure = live.surrogate ? bounds?.error?.[k * n_y + limit.output] ?? Infinity : 0;  // a surrogate has errors
      const by = Math.max(limit.low === null ? 0 : limit.low - y, limit.high === null ? 0 : y - limit.high) - unsure;
      if (by > most.by) most = { by, time: k };
    }
    return most;
  }

  function verdict(limit, found) {  // a word, a text, and the time at which the worst case is nearest to the limit or beyond it
    const { unit } = outputs[limit.output], [a, b] = [excess(limit, run?.rows), excess(limit, found?.rows)];
    const most = a.by > b.by ? a : b, said = (word, text, time = found?.time) => ({ word, text, time });
    if (most.by > 0) return said("violated", `violated: exceeded by ${quantity(most.by, unit)}${when(limit, most.time)}`, most.time);
    if (!found) return fault ? said("undecided", "undecided: there are no bounds") : said("", "…");
    const unsure = found.error > 1e-3 * Math.abs(found.margin) ? `, error up to ${quantity(found.error, unit)}` : "";
    const margin = `margin ${quantity(found.margin, unit)}${when(limit, found.time)}${unsure}`;
    if (found.margin >= found.error) return said("satisfied", `satisfied: smallest ${margin}`);
    if (!bounds.done) return said("", `${margin}, refining …`);
    const why = found.margin < 0 ? `bounds exceed it by ${quantity(-found.margin, unit)}${when(limit, found.time)}` : margin;
    return said("undecided", `undecided: ${why}. The polynomials are too inaccurate here, as near jumps. bounds.check in Python can decide.`);
  }

  const varied = i => state[i].tolerance > 0 && !state[i].held;
  const worstText = found => parameters.flatMap(({ name, unit }, i) =>
    varied(i) ? [`${brief(name)} = ${withUnit(within(found.parameters[i], state[i].tolerance), unit)}`] : []).join(", ");

  function stateText() {
    if (fault) return fault;
    if (!run) return "computing the run …";
    if (!bounds) return "computing bounds …";
    const runs = live.surrogate ? "evaluations" : "runs", held = parameters.filter((_, i) => state[i].held);
    const end = held.length ? `. Held at the value, without tolerance: ${held.map(({ name }) => brief(name)).join(", ")}.` : ".";
    if (bounds.runs === 1) return `1 ${runs.slice(0, -1)}; no parameter has a tolerance${end}`;
    let error = 0;
    for (let i = outputAt(); i < bounds.error.length; i += n_y) error = Math.max(error, bounds.error[i]);
    const { name, unit } = outputs[outputAt()];
    const told = Number.isFinite(error) ? `, error of ${brief(name)} ≤ ${quantity(error, unit)} (estimate)` : "";
    return `${bounds.runs} ${runs}${told}${bounds.done ? end : ", refining …"}`;
  }

  function factorText() {
    const limit = limits[focus], own = effects?.limits[focus];
    if (!own || !state.some((_, i) => varied(i)) || verdict(limit, bounds.limits[focus]).word === "undecided") return "";
    if (own.factor === 0) return "The nominal run is already beyond the limit.";
    const factor = own.factor?.toPrecision(3);
    if (factor) return `With all tolerances ${+factor} times as large, the output just reaches the limit.`;
    return live.surrogate ? "Tolerances up to 3 times as large, within the box of the study, do not reach the limit."
      : "Even 3 times the tolerances do not reach the limit.";
  }

  // Painting: once a picture at most, whatever has arrived
  function plan() { planned ||= requestAnimationFrame(paint); }

  function paint() {
    cancelAnimationFrame(planned);
    planned = 0;
    const said = limits.map((limit, i) => verdict(limit, bounds?.limits[i])), time = said[focus]?.time;
    if (going && bounds?.done) {
      going = false;
      if (time !== undefined && !outputs[outputAt()].scalar) { play(false); seek(nearest(first, live.times[time])); }
    }
    if (run || fault) paintDrawing(time);  // the drawing stays for the few milliseconds until the new run arrives
    tell($("state"), stateText());
    $("state").className = fault ? "fault" : "";
    said.forEach(({ word, text }, i) => {
      const found = bounds?.limits[i], button = $("limits").children[i];
      button.className = word;
      button.setAttribute("aria-pressed", i === focus);
      tell(button.children[1], text);
      tell(button.children[2], found ? `worst case: ${worstText(found) || "nominal run"}` : "");
      button.children[2].hidden = i !== focus;
    });
    const limit = effects?.limits[focus], own = outputAt(), { unit } = outputs[own];
    const widths = parameters.map((_, i) => !effects ? 0 : limit ? limit.widths[i] : effects.widths[own * parameters.length + i]);
    const most = Math.max(...widths) || 1;
    controls.forEach(({ bar, width }, i) => {
      const size = quantity(widths[i], unit), still = state[i].held ? "held, no effect" : "no tolerance";
      bar.style.width = `${100 * widths[i] / most}%`;
      width.textContent = !effects ? fault ? "" : "…" : !varied(i) ? still : limit ? `${size} towards the limit` : `width ${size}`;
    });
    tell($("factor"), factorText());
    curves.forEach(({ i, c }) => c.parentElement.setAttribute("aria-current", i === own));
  }

  function paintDrawing(time) {
    const found = bounds?.limits[focus], rows = run?.rows ?? new Float64Array(n_t * n_out).fill(NaN);
    write(0, rows);
    write(1, found?.rows ?? rows);
    writeBounds();
    runs = found?.rows ? page.runs : page.runs.slice(0, 1);
    page.mark = time !== undefined && !outputs[outputAt()].scalar && { output: outputAt(), time: live.times[time] };
    if (fitted < 1 || fitted < 2 && found?.rows) { fit(); fitted = found?.rows ? 2 : 1; }
    const seen = $("curves").getBoundingClientRect();
    drawCurves(curves.filter(curve => {
      const { top, bottom } = curve.c.getBoundingClientRect();
      if (bottom < seen.top || top > seen.bottom) return false;
      curve.range = rangeWith(curve);
      return true;
    }));
    show();
  }

  function rangeWith({ i, range, levels }) {  // scales stay as they are until a curve leaves them or is small in them
    const all = [...runs.map(run => run.values), page.bounds.lower, page.bounds.upper].map(at => column(at, i, n_y));
    let [low, high] = rangeOf(all);
    if (low > high) return range ?? [-1, 1];  // there are no numbers
    const size = high - low, near = levels.filter(end => end > low - size && end < high + size);
    [low, high] = [Math.min(low, ...near), Math.max(high, ...near)];
    return range && low >= range[0] && high <= range[1] && high - low > (range[1] - range[0]) / 3 ? range : [low, high];
  }

  // Studies
  const worker = new Worker(URL.createObjectURL(new Blob([$("worker").textContent])));
  worker.onmessage = ({ data }) => {
    if ((data.id ?? id) !== id) return;  // a fault at the start has no number
    if (data.kind === "fault") return fail(data.fault);
    if (data.kind === "run") [run, took.run] = [data, data.ms];
    if (data.kind === "bounds") [bounds, took.bounds] = [data, data.ms];
    if (data.kind === "effects") effects = data;
    if (data.kind === "bounds" && data.done && !data.fault && !chosen) nearestLimit();
    if (data.fault) {
      if (data.kind === "bounds") bounds = null;
      return fail(data.kind === "run" ? `The run ended at ${at(Math.max(data.finished - 1, 0))}: ${data.fault}`
        : `There are no bounds, because a run in the box failed: ${data.fault}`);
    }
    if (data.kind === "bounds" && data.done) settle();
    else plan();
  };
  worker.onerror = ({ message }) => fail(`The computation stopped: ${message}`);

  function nearestLimit() {  // the limit with the smallest margin, relative to the largest width of its bounds
    const near = bounds.limits.map(({ margin, output }) => {
      let width = 1e-300;
      for (let i = output; i < bounds.lower.length; i += n_y) width = Math.max(width, bounds.upper[i] - bounds.lower[i]);
      return margin / width;
    });
    $("focus").value = focus = Math.max(0, near.indexOf(Math.min(...near)));
  }

  function fail(text) { fault = text; settle(Error(text)); }

  function settle(error) {
    paint();
    for (const { go, stop } of waiting.splice(0)) if (error) stop(error); else go();
  }

  function study() {
    [run, bounds, effects, fault, going] = [null, null, null, null, false];
    $("copied").hidden = true;
    worker.postMessage({ kind: "study", id: ++id, values: state.map(p => p.value),
                         tolerances: state.map(({ tolerance }, i) => varied(i) ? tolerance : 0), limits });
    remember();
    const done = new Promise((go, stop) => waiting.push({ go, stop }));
    done.catch(() => {});  // the panel states the fault too
    return done;
  }

  // State in the address: #p0=1.2,0.05&p3=9.81,5%,held&focus=2, for the parameters that differ from the scene
  function remember() {  // after the last of several moves
    clearTimeout(saving);
    saving = setTimeout(saveState, 300);
  }

  function saveState() {
    const texts = state.map(({ value, tolerance, percent, held }) =>
      `${digits(value)},${percent === null ? digits(tolerance) : `${percent}%`}${held ? ",held" : ""}`);
    const own = state.flatMap((now, i) => Object.keys(now).every(key => now[key] === original[i][key]) ? [] : [`p${i}=${texts[i]}`]);
    if (chosen) own.push(`focus=${focus}`);
    try {
      history.replaceState(null, "", `#${own.join("&")}`);
    } catch { }  // a page in a notebook has no address of its own
  }

  function loadState(address = new URLSearchParams(location.hash.slice(1))) {
    original.forEach((p, i) => {
      const [value, tolerance, held] = (address.get(`p${i}`) ?? "").split(",");
      const number = text => text && Number.isFinite(Number(text)) ? Number(text) : undefined, change = {};
      const [is, size] = tolerance?.endsWith("%") ? ["percent", number(tolerance.slice(0, -1))] : ["tolerance", number(tolerance)];
      if (size !== undefined) change[is] = Math.abs(size);
      state[i] = changed(i, { ...change, value: number(value) ?? p.value, held: held === "held" }, p);
      fill(i);
    });
    chosen = address.has("focus") && Boolean($("focus").options[address.get("focus")]);
    focus = chosen ? Number(address.get("focus")) : 0;
    $("focus").value = focus;
  }

  // Controls
  function controlsOf(p, i) {
    const row = (kind, title, unit) => {
      const slider = element("input", { type: "range", step: "any" }), number = element("input", { type: "number" });
      const about = element("small", {}), own = () => kind === "tolerance" && state[i].percent !== null ? "percent" : kind;
      slider.oninput = () => move(i, { [own()]: digits(Math.round(slider.value / number.step) * number.step) });
      number.onchange = () => {
        const given = number.valueAsNumber;
        if (Number.isFinite(given) && (kind === "value" || given >= 0)) move(i, { [own()]: given });
        else fill(i);
      };
      slider.ariaLabel = number.ariaLabel = `${title} of ${p.name}`;
      const box = element("div", { className: `row ${kind}` }, element("span", {}, title, about), slider, number, unit);
      const put = (size, low, high) => {  // sliders have steps of 1/200 to 1/2000 of their length
        Object.assign(slider, { min: low, max: digits(high), value: digits(size) });
        Object.assign(number, { step: +`1e${Math.floor(Math.log10((high - low || 1) / 200))}`, value: digits(size) });
      };
      return { box, about, put };
    };
    const kind = element("select", { onchange: () => move(i, kind.value === "%" ? { percent: shareOf(state[i]) } : { tolerance: state[i].tolerance }) },
      element("option", { value: "" }, p.unit || "abs."), element("option", {}, "%"));
    kind.ariaLabel = kind.title = "tolerance in its unit, or in percent of the value";
    const value = row("value", "value", element("small", { className: "unit" }, p.unit)), tolerance = row("tolerance", "tolerance ±", kind);
    const hold = element("input", { type: "checkbox", onchange: () => move(i, { held: hold.checked }) });
    const reset = element("button", { textContent: "reset", title: `reset ${p.name}`, onclick: () => move(i, original[i]) });
    const bar = element("i", {}), width = element("small", {}, "…");
    const box = element("fieldset", {}, element("legend", { title: p.name }, p.name), element("label", {}, hold, "hold at this value"), reset,
      value.box, tolerance.box, element("div", { className: "bar" }, bar, width));
    $("parameters").append(box);
    return { value, tolerance, kind, hold, bar, width, box };
  }

  function roomOf(value, i) { return Math.min(value - parameters[i].low, parameters[i].high - value); }  // a surrogate is only known in its box

  function changed(i, change, before = state[i]) {  // the new state of a parameter
    let { value, tolerance, percent, held } = { ...before, ..."tolerance" in change && { percent: null }, ...change };
    if (live.surrogate) value = Math.min(Math.max(value, parameters[i].low), parameters[i].high);
    if (percent !== null) tolerance = Math.abs(value) * percent / 100;
    const most = roomOf(value, i);
    if (live.surrogate && tolerance > most) {
      tolerance = most;
      if (percent !== null) percent = shareOf({ value, tolerance });
    }
    return { value, tolerance, percent, held };
  }

  function fill(i) {  // the controls of a parameter, from its state
    const { value, tolerance, kind, hold, box } = controls[i], own = state[i], { low, high, unit, value: middle } = parameters[i];
    const inPercent = own.percent !== null, most = live.surrogate ? roomOf(own.value, i) : parameters[i].most;
    value.put(own.value, low, high);
    tolerance.put(own.percent ?? own.tolerance, 0, inPercent ? shareOf({ value: (live.surrogate ? own.value : middle) || 1, tolerance: most }) : most);
    tolerance.about.textContent = inPercent ? `= ${quantity(own.tolerance, unit)}` : own.value && own.tolerance ? `= ${short(shareOf(own))}\u00a0%` : "";
    kind.selectedIndex = Number(inPercent);
    kind.disabled = !own.value;  // there is no percentage of 0
    hold.checked = own.held;
    box.classList.toggle("held", own.held);
  }

  function move(i, change) {
    state[i] = changed(i, change);
    fill(i);
    return study();
  }

  function look(k) {  // at the worst case of a limit, or at an output
    [focus, chosen, going] = [k, true, k < limits.length];
    $("focus").value = k;
    remember();
    curves[outputAt()].c.parentElement.scrollIntoView({ block: "nearest" });
    paint();
  }

  function python() {  // JSON is Python for texts and finite numbers
    const text = JSON.stringify, pairs = (own, value) => `{${own.map(each => `${text(each.name)}: ${value(each)}`).join(", ")}}`;
    const all = parameters.map(({ name }, i) => ({ name, ...state[i], is_varied: varied(i) })), some = all.filter(p => p.is_varied);
    const deviations = pairs(some.length ? some : all, p => !p.is_varied ? 0 : p.percent === null ? digits(p.tolerance) : `"${p.percent}%"`);
    const ends = pairs(all, p => `(${[-1, 1].map(side => digits(p.value + (p.is_varied && side * p.tolerance))).join(", ")})`);
    const ofLimits = limits.map(({ output, low, high }) => ({ name: outputs[output].name, ends: `(${[low, high].map(end => end ?? "None").join(", ")})` }));
    const subject = live.surrogate ? ["simulator", "function, program or FMU"] : ["scene", "scene"];
    return ["import symmb as mb", live.source || `# ${subject[0]}: the ${subject[1]} ${text(document.title)} of this page`,
      ...live.surrogate ? [`box = mb.Box(**${ends})`]
        : [`scene = scene.with_nominal(${pairs(all, p => digits(p.value))})`, `box = mb.Box.plus_minus(scene.system.parameters, **${deviations})`],
      `bounds = mb.propagate(${subject[0]}, box=box)`,
      limits.length ? `print(bounds.check(${pairs(ofLimits, ({ ends }) => ends)}))` : "print(bounds)"].join("\n") + "\n";
  }

  function curveOf(i) {
    const of = (values, width) => values ? Array.from({ length: n_t }, (_, k) => values[k * width + i]) : null;
    return { times: [...live.times], nominal: of(run?.rows, n_out), lower: of(bounds?.lower, n_y),
             upper: of(bounds?.upper, n_y), estimate: of(bounds?.error, n_y) };
  }

  function csv() {
    const own = outputs.map((_, i) => curveOf(i)), parts = { nominal: "", lower: " lower", upper: " upper", estimate: " estimate of error" };
    const head = ["time [s]", ...outputs.flatMap(({ name, unit }) => Object.values(parts).map(of => `${name}${unit && ` [${unit}]`}${of}`))];
    const lines = live.times.map((t, k) => [t, ...own.flatMap(curve => Object.keys(parts).map(of => curve[of]?.[k] ?? ""))]);
    return [head.map(text => `"${text.replaceAll('"', '""')}"`), ...lines].map(line => line.join(",")).join("\r\n") + "\r\n";
  }

  function save() {
    if (!run) return;
    const address = URL.createObjectURL(new Blob([csv()], { type: "text/csv" }));
    element("a", { href: address, download: "curves.csv" }).click();
    setTimeout(() => URL.revokeObjectURL(address), 1000);
  }

  // Scripts
  function set(changes) {
    const all = Object.entries(changes).map(([name, change]) => {
      const i = parameters.findIndex(p => p.name === name);
      if (i < 0) throw Error(`There is no parameter ${name}.`);
      const { value, tolerance, percent } = { ...state[i], ...change };
      if (![value, tolerance, percent ?? 0].every(Number.isFinite) || tolerance < 0 || percent < 0)
        throw Error(`Parameter ${name} needs a finite value, and a finite tolerance that is not negative.`);
      return [i, change];
    });
    for (const [i, change] of all) { state[i] = changed(i, change); fill(i); }
    return study();
  }

  function result(name) {
    const i = outputs.findIndex(own => own.name === name);
    if (i < 0) throw Error(`There is no output ${name}.`);
    return curveOf(i);
  }

  limits.forEach((limit, k) => $("limits").append(element("button", { onclick: () => look(k), title: "show the worst case" },
    element("b", {}, limitText(limit)), element("span", {}), element("small", {}))));
  [...limits.map(limitText), ...outputs.map(({ name }) => brief(name))].forEach((text, k) =>
    $("focus").append(element("option", { value: k }, text)));
  $("focus").onchange = () => look(Number($("focus").value));
  $("reset").onclick = () => { loadState(new URLSearchParams()); study(); };
  $("copy").onclick = () => {
    $("copied").textContent = python();
    $("copied").hidden = false;
    navigator.clipboard?.writeText(python()).catch(() => {});  // where this is not allowed, the text can be selected
  };
  $("save").onclick = save;
  $("curves").onscroll = plan;
  for (const curve of curves)
    curve.levels = limits.flatMap(({ output, low, high }) => output === curve.i ? [low, high].filter(end => end !== null) : []);
  const controls = parameters.map(controlsOf);
  for (const part of [$("panel"), $("several")]) part.addEventListener("keydown", e => e.stopPropagation());  // keys of the viewer
  $("several").lastChild.data = "worst case";
  const legend = document.querySelector("header div"), entry = (text, color) => Object.assign(element("em", {}, text), { style: `color: ${color}` });
  legend.prepend(entry("run", page.palette[0]));
  legend.append(entry("bounds", "#7c98b6"));
  $("several").hidden = legend.children[1].hidden = !limits.length;
  addEventListener("hashchange", () => { loadState(); study(); });
  addEventListener("resize", () => {
    for (const node of $("panel").querySelectorAll("[style]")) node.style.minHeight = "";
    plan();
  });
  [$("note").textContent, $("note").hidden] = [live.note ?? "", !live.note];
  loadState();
  worker.postMessage({ kind: "start", live });
  return { ready: study(), set, result, csv, engine: () => ({ ...took }) };
})();
