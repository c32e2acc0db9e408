"use strict";
// The flights view over counts that the server makes: brushes go there, bins come back.
(async () => {
  const at = (id) => document.getElementById(id);
  const token = document.body.dataset.token;
  const colors = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"];
  const ask = async (place, data) => {
    const options = data === undefined ? {} : { method: "POST", body: JSON.stringify(data) };
    const reply = await fetch(`${place}?token=${encodeURIComponent(token)}`, options);
    const found = await reply.json();
    if (!reply.ok) throw new Error(found.error);
    return found;
  };
  const view = await ask("view");
  const state = { brushes: {}, found: null, all: null, asked: 0, channel: "bank_deg" };
  const columns = [...view.dispersions, ...view.metrics];
  const labelOf = (name) => columns.find((entry) => entry.name === name).label;
  const text = (value) => (typeof value === "number" ? String(Number(value.toPrecision(4))).replace("-", "\u2212") : value ?? "none");
  const ink = () => getComputedStyle(document.body).color;
  at("name").textContent = view.name.replaceAll("_", " ");
  at("folder").textContent = view.folder;
  for (const id of ["x", "y"]) for (const entry of columns) at(id).append(new Option(entry.label, entry.name, false, entry.name === view[id]));
  view.controllers.forEach((controller, k) => {
    const box = Object.assign(document.createElement("input"), { type: "checkbox", checked: true, value: controller.name });
    const label = document.createElement("label");
    label.append(box, ` ${controller.label}`);
    label.style.borderBottom = `3px solid ${colors[k % colors.length]}`;
    at("controllers").append(label);
    box.addEventListener("change", () => count());
  });
  for (const head of ["Flight", "Controller", "Outcome", ...view.headed.map((entry) => entry.label)]) {
    at("heads").append(Object.assign(document.createElement("th"), { scope: "col", textContent: head }));
  }
  const asked = () => ({ x: at("x").value, y: at("y").value, outcome: at("outcome").value, brushes: state.brushes,
    controllers: [...document.querySelectorAll("#controllers input:checked")].map((box) => box.value) });

  const ready = (canvas) => {
    const scale = window.devicePixelRatio || 1;
    [canvas.width, canvas.height] = [canvas.clientWidth * scale, canvas.clientHeight * scale];
    const pen = canvas.getContext("2d");
    pen.scale(scale, scale);
    return pen;
  };
  const frame = () => {
    const [canvas, left, bottom] = [at("density"), 70, 40];
    const [wide, high] = [canvas.clientWidth - left - 12, canvas.clientHeight - bottom - 8];
    const [xs, ys] = [view.ranges[at("x").value], view.ranges[at("y").value]];
    const size = (ends) => ends[1] - ends[0] || 1;
    return { canvas, left, wide, high, xs, ys, px: (v) => left + wide * (v - xs[0]) / size(xs), py: (v) => 8 + high * (1 - (v - ys[0]) / size(ys)),
      x: (p) => xs[0] + size(xs) * (p - left) / wide, y: (p) => ys[0] + size(ys) * (1 - (p - 8) / high) };
  };
  const drawDensity = () => {
    const box = frame();
    const pen = ready(box.canvas);
    const [across, up] = view.cells;
    const most = Math.max(1, ...state.found.cells.map((cell) => cell[3]));
    for (const [k, i, j, n] of state.found.cells) {
      pen.globalAlpha = 0.12 + 0.75 * Math.log1p(n) / Math.log1p(most);
      pen.fillStyle = colors[k % colors.length];
      pen.fillRect(box.left + box.wide * i / across, 8 + box.high * (1 - (j + 1) / up), Math.ceil(box.wide / across), Math.ceil(box.high / up));
    }
    for (const [k, x, y, , lost] of state.found.points) {
      pen.globalAlpha = 0.7;
      pen.fillStyle = pen.strokeStyle = colors[k % colors.length];
      const [a, b] = [box.px(x), box.py(y)];
      pen.beginPath();
      if (lost) { pen.moveTo(a - 4, b - 4); pen.lineTo(a + 4, b + 4); pen.moveTo(a - 4, b + 4); pen.lineTo(a + 4, b - 4); pen.stroke(); }
      else { pen.arc(a, b, 2.5, 0, 7); pen.fill(); }
    }
    pen.globalAlpha = 1;
    pen.fillStyle = pen.strokeStyle = ink();
    pen.strokeRect(box.left, 8, box.wide, box.high);
    pen.font = "12px system-ui, sans-serif";
    for (const part of [0, 0.25, 0.5, 0.75, 1]) {
      pen.textAlign = part === 1 ? "right" : "center";
      pen.fillText(text(box.xs[0] + part * (box.xs[1] - box.xs[0])), box.left + part * box.wide, box.high + 24);
      pen.textAlign = "right";
      pen.fillText(text(box.ys[0] + part * (box.ys[1] - box.ys[0])), box.left - 6, 14 + box.high * (1 - part) - (part ? 0 : 4));
    }
    pen.textAlign = "center";
    pen.fillText(labelOf(at("x").value), box.left + box.wide / 2, box.high + 42);
    pen.save();
    pen.translate(12, 8 + box.high / 2);
    pen.rotate(-Math.PI / 2);
    pen.fillText(labelOf(at("y").value), 0, 0);
    pen.restore();
  };
  const drawStrips = () => {
    for (const canvas of document.querySelectorAll("#strips canvas")) {
      const pen = ready(canvas);
      const { clientWidth: wide, clientHeight: high } = canvas;
      const name = canvas.dataset.column;
      const most = Math.max(1, ...state.all.strips[name].map((bar) => bar[1]));
      const chosen = Math.max(1, ...state.found.strips[name].map((bar) => bar[1]));
      // Grey: all flights. Blue: those chosen, each to its own largest bar, as few among many would not be seen.
      for (const [bars, top, color, alpha] of [[state.all.strips[name], most, ink(), 0.2], [state.found.strips[name], chosen, colors[0], 0.7]]) {
        pen.globalAlpha = alpha;
        pen.fillStyle = color;
        for (const [bar, n] of bars) pen.fillRect(wide * bar / 60, high * (1 - n / top), wide / 60, high * n / top);
      }
    }
  };
  const drawTable = () => {
    at("rows").replaceChildren();
    for (const [controller, flight, outcome, ...metrics] of state.found.worst) {
      const line = at("rows").insertRow();
      const button = Object.assign(document.createElement("button"), { type: "button", textContent: flight });
      button.setAttribute("aria-label", `Fly flight ${flight} of ${controller} again`);
      button.addEventListener("click", () => fly(controller, flight));
      line.insertCell().append(button);
      const { label } = view.controllers.find((entry) => entry.name === controller);
      for (const cell of [label, outcome.replaceAll("_", " "), ...metrics.map(text)]) line.insertCell().textContent = cell;
    }
    at("count").textContent = `${state.found.count.toLocaleString("en")} of ${state.all.count.toLocaleString("en")} flights` +
      `${state.found.points.length ? "; a cross ended early" : "; shades count flights"}`;
  };
  const count = async () => {
    const number = (state.asked += 1);
    const found = await ask("counts", asked());
    if (number !== state.asked) return; // another brush came after this one
    state.found = found;
    state.all ??= found;
    drawDensity(); drawStrips(); drawTable();
    document.body.dataset.drawn = number;
  };

  const drawFlight = () => {
    const { flown } = state;
    const layout = (x, y) => ({ margin: { l: 60, r: 10, t: 10, b: 44 }, height: 300, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      font: { color: ink(), size: 12 }, xaxis: { title: { text: x }, zeroline: false }, yaxis: { title: { text: y }, zeroline: false } });
    const color = colors[view.controllers.findIndex((entry) => entry.name === flown.controller) % colors.length];
    const line = (x, y) => [{ type: "scatter", mode: "lines", x, y, line: { color, width: 1.8 } }];
    const { unit, values } = flown.channels[state.channel];
    const config = { responsive: true, displayModeBar: false, plotlyServerURL: "" };
    Plotly.react("history", line(flown.time, values), layout("time (s)", `${state.channel.replaceAll("_", " ")}${unit ? ` (${unit})` : ""}`), config);
    const [east, north] = ["east_m", "north_m"].map((name) => flown.channels[name].values.map((v) => (v === null ? null : v / 1000)));
    Plotly.react("track", line(east, north), layout("east (km)", "north (km)"), config);
  };
  const fly = async (controller, flight) => {
    const name = `${view.controllers.find((entry) => entry.name === controller).label}, flight ${flight}`;
    at("flight-panel").hidden = false;
    at("flight-title").textContent = `${name}: flying`;
    at("flight-command").textContent = `abhv-mc replay ${view.folder} --flight ${flight} --controller ${controller}`;
    at("flight-same").textContent = "";
    try {
      state.flown = await ask("flight", { controller, flight });
    } catch (error) {
      at("flight-title").textContent = `${name}: ${error.message}`;
      return;
    }
    at("flight-title").textContent = `${name}: ${state.flown.sentence}`;
    at("flight-same").textContent = state.flown.same ? "Its metrics equal the stored ones bit for bit." : "Its metrics differ from the stored ones!";
    if (!at("channel").length) for (const name of Object.keys(state.flown.channels)) at("channel").append(new Option(name.replaceAll("_", " "), name, false, name === state.channel));
    drawFlight();
    at("flight-panel").scrollIntoView({ block: "nearest" });
    document.body.dataset.flown = flight;
  };
  const nearest = async (x, y) => {
    const found = await ask("nearest", { ...asked(), at: [x, y] });
    if (found) fly(...found);
  };
  const dragged = (canvas, ended) => {
    let from = null;
    canvas.addEventListener("pointerdown", (event) => { from = [event.offsetX, event.offsetY]; canvas.setPointerCapture(event.pointerId); });
    canvas.addEventListener("pointerup", (event) => { if (from) ended(from, [event.offsetX, event.offsetY]); from = null; });
  };
  dragged(at("density"), (a, b) => {
    const box = frame();
    if (Math.hypot(a[0] - b[0], a[1] - b[1]) < 4) { nearest(box.x(b[0]), box.y(b[1])); return; }
    const sorted = (one, other) => [one, other].sort((p, q) => p - q);
    state.brushes[at("x").value] = sorted(box.x(a[0]), box.x(b[0]));
    state.brushes[at("y").value] = sorted(box.y(a[1]), box.y(b[1]));
    count();
  });
  for (const name of view.strips) {
    const strip = Object.assign(document.createElement("div"), { className: "strip" });
    const canvas = document.createElement("canvas");
    canvas.dataset.column = name;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `Values of ${labelOf(name)}`);
    strip.append(Object.assign(document.createElement("span"), { textContent: labelOf(name) }), canvas);
    at("strips").append(strip);
    dragged(canvas, (a, b) => {
      const [low, high] = view.ranges[name];
      const ends = [a[0], b[0]].sort((p, q) => p - q).map((p) => low + (high - low) * p / canvas.clientWidth);
      if (b[0] === a[0]) delete state.brushes[name]; else state.brushes[name] = ends;
      count();
    });
  }
  view.missed.forEach((words, k) => at("outcome").append(new Option(`missed: ${words}`, `missed ${k}`)));
  for (const id of ["x", "y", "outcome"]) at(id).addEventListener("change", count);
  at("channel").addEventListener("change", () => { state.channel = at("channel").value; drawFlight(); });
  at("controls").addEventListener("submit", (event) => event.preventDefault());
  at("clear").addEventListener("click", () => { state.brushes = {}; count(); });
  at("between").addEventListener("click", () => {
    const name = at("x").value;
    const [low, high] = ["low", "high"].map((id, i) => (at(id).value === "" ? view.ranges[name][i] : Number(at(id).value)));
    state.brushes[name] = [low, high];
    count();
  });
  addEventListener("resize", () => { if (state.found) { drawDensity(); drawStrips(); } });
  await count();
})();
