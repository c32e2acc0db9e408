"use strict";
// Every point a flight: a scatter, the dispersions, a table and the flight's history, all of the same flights.
const flightsView = (data, numbers, style) => {
  const at = (id) => document.getElementById(id);
  const rows = data.rows; // controller index, flight number and outcome of each row
  const count = rows.controller.length;
  const column = (name) => numbers(`column:${name}`);
  const labelOf = (entry) => (entry.unit ? `${entry.label} (${entry.unit})` : entry.label);
  const all = [...data.metrics, ...data.dispersions];
  const state = { controllers: new Set(data.controllers.map((_, i) => i)), outcome: "all", brush: null, current: -1 };

  const shares = { all: () => true, failed: (row) => rows.failed[row] === 1, ok: (row) => rows.failed[row] === 0 };
  data.missed.forEach((words, k) => {
    shares[`missed ${k}`] = (row) => rows.missed[k][row] === 1;
    at("flights-outcome").append(new Option(`missed: ${words}`, `missed ${k}`));
  });
  const shown = (row) => state.controllers.has(rows.controller[row]) && shares[state.outcome](row);
  const chosen = (row) => shown(row) && (!state.brush || state.brush.has(row));
  const numberText = (value) => (Number.isFinite(value) ? String(Number(value.toPrecision(4))).replace("-", "\u2212") : "none");
  const grouped = (number) => number.toLocaleString("en").replaceAll(",", "\u202f"); // as in the page's tables
  const name = (row) => `${data.controllers[rows.controller[row]].label}, flight ${rows.flight[row]}`;

  // A list of buttons is one stop of the Tab key; the arrows go through it.
  const oneStop = (list) => {
    const buttons = () => [...list.querySelectorAll("button")];
    const stop = (chosen) => { for (const button of buttons()) button.tabIndex = button === chosen ? 0 : -1; };
    list.addEventListener("focusin", (event) => stop(event.target));
    list.addEventListener("keydown", (event) => {
      const all = buttons();
      const here = all.indexOf(document.activeElement);
      const next = { ArrowDown: here + 1, ArrowUp: here - 1, Home: 0, End: all.length - 1 }[event.key];
      if (next === undefined) return;
      event.preventDefault();
      all[next]?.focus();
    });
    return () => stop(buttons()[0]);
  };
  const restop = oneStop(at("flight-rows"));

  const fill = (select, entries, first) => {
    for (const entry of entries) select.append(new Option(labelOf(entry), entry.name, false, entry.name === first));
  };
  fill(at("scatter-x"), [...data.dispersions, ...data.metrics], data.start.x);
  fill(at("scatter-y"), all, data.start.y);

  const layout = (x, y, extra = {}) => ({
    margin: { l: 64, r: 10, t: 24, b: 44 }, hovermode: "closest", modebar: { bgcolor: "rgba(0,0,0,0)", color: style.ink(), activecolor: style.link() }, showlegend: false, paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "rgba(0,0,0,0)", font: { family: style.font, size: 12, color: style.ink() },
    xaxis: { title: { text: x }, gridcolor: style.line(), zeroline: false },
    yaxis: { title: { text: y }, gridcolor: style.line(), zeroline: false, exponentformat: "none" }, ...extra,
  });
  const config = { responsive: true, displaylogo: false, plotlyServerURL: "",
    modeBarButtons: [["select2d", "lasso2d", "zoom2d", "pan2d", "resetScale2d", "toImage"]] };

  const drawScatter = () => {
    const [x, y] = ["scatter-x", "scatter-y"].map((id) => all.find((entry) => entry.name === at(id).value));
    const [xs, ys] = [column(x.name), column(y.name)];
    const traces = data.controllers.map((controller, k) => {
      const members = [...Array(count).keys()].filter((row) => rows.controller[row] === k && shown(row));
      return { type: "scatter", mode: "markers", name: controller.label, x: members.map((row) => xs[row]),
        y: members.map((row) => ys[row]), customdata: members,
        text: members.map((row) => name(row)), hovertemplate: "%{text}<br>%{x:.5g}, %{y:.5g}<extra></extra>",
        selectedpoints: state.brush ? members.flatMap((row, i) => (state.brush.has(row) ? [i] : [])) : null,
        marker: { color: controller.color, size: members.map((row) => (row === state.current ? 14 : rows.failed[row] ? 9 : 6)),
          symbol: members.map((row) => (rows.failed[row] ? "x" : controller.mark)), opacity: 0.75,
          line: { width: members.map((row) => (row === state.current ? 2 : 0)), color: style.ink() } },
        unselected: { marker: { opacity: 0.08 } } };
    });
    const limit = data.limits[y.name];
    const shapes = (limit || []).map((value) => ({ type: "line", xref: "paper", x0: 0, x1: 1, y0: value, y1: value,
      line: { color: style.ink(), width: 1.5, dash: "dash" } }));
    Plotly.react("scatter", traces, layout(labelOf(x), labelOf(y), { dragmode: "select", shapes, height: 420 }), config);
  };

  const drawStrips = () => {
    for (const strip of document.querySelectorAll("canvas[data-dispersion]")) {
      const values = column(strip.dataset.dispersion);
      const scale = window.devicePixelRatio || 1;
      strip.width = strip.clientWidth * scale;
      strip.height = strip.clientHeight * scale;
      const pen = strip.getContext("2d");
      const { low, high } = data.places[`column:${strip.dataset.dispersion}`];
      const place = (row) => (Number.isFinite(values[row]) ? (values[row] - low) / (high - low || 1) : 1) * (strip.width - 6 * scale) + 3 * scale;
      for (const pass of [false, true]) {
        for (let row = 0; row < count; row += 1) {
          if (!shown(row) || chosen(row) !== pass) continue;
          pen.globalAlpha = pass ? (state.brush ? 0.8 : 0.35) : 0.06;
          pen.fillStyle = data.controllers[rows.controller[row]].color;
          const lane = (rows.controller[row] + ((rows.flight[row] * 0.618) % 1)) / data.controllers.length;
          pen.fillRect(place(row) - scale, lane * strip.height, 2 * scale, 2 * scale);
        }
      }
      if (state.current >= 0) {
        pen.globalAlpha = 1;
        pen.fillStyle = style.ink();
        pen.fillRect(place(state.current) - scale, 0, 2 * scale, strip.height);
      }
    }
  };

  const drawTable = () => {
    const body = at("flight-rows");
    const focused = body.contains(document.activeElement);
    body.replaceChildren();
    const members = data.order.filter(chosen);
    at("flight-count").textContent = `${grouped(members.length)} of ${grouped(count)} flights` +
      `${members.length > data.listed ? `; the ${data.listed} worst are listed` : ""}${data.left ? `. ${data.left}` : ""}`;
    for (const row of members.slice(0, data.listed)) {
      const line = body.insertRow();
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = rows.flight[row];
      button.setAttribute("aria-label", `Show ${name(row)}`);
      button.addEventListener("click", () => show(row));
      const head = document.createElement("th");
      head.scope = "row";
      head.append(button);
      line.append(head);
      if (row === state.current) line.className = "current";
      for (const text of [data.controllers[rows.controller[row]].label, data.outcomes[rows.outcome[row]],
        ...data.headed.map((metric) => numberText(column(metric)[row])),
        rows.history[row] >= 0 ? "kept" : ""]) line.insertCell().textContent = text;
    }
    restop();
    if (focused) (body.querySelector(".current button") || body.querySelector("button"))?.focus();
  };

  const drawFlight = () => {
    const row = state.current;
    at("flight-panel").hidden = row < 0;
    if (row < 0) return;
    const controller = data.controllers[rows.controller[row]];
    at("flight-title").textContent = `${name(row)}: ${data.outcomes[rows.outcome[row]]}`;
    at("flight-command").textContent = `abhv-mc replay ${data.folder} --flight ${rows.flight[row]} --controller ${controller.name}`;
    const h = rows.history[row];
    at("flight-kept").hidden = h >= 0;
    at("flight-plots").hidden = h < 0;
    if (h < 0) return;
    const channel = data.channels[at("flight-channel").selectedIndex];
    const history = (entry) => numbers(`history:${entry}`, h);
    const time = numbers("history-time");
    const line = (y, label, dash, color) => ({ type: "scatter", mode: "lines", x: time, y, name: label, line: { dash, color, width: 1.8 } });
    const traces = [line(history(channel.name), "flown", "solid", controller.color)];
    if (channel.command) traces.push(line(history(channel.command), "command", "dot", controller.color));
    Plotly.react("flight-history", traces, layout("time (s)", labelOf(channel), { height: 300, showlegend: true, legend: { orientation: "h" } }), config);
    if (data.track) {
      Plotly.react("flight-track", [{ type: "scatter", mode: "lines", x: history("east_m").map((v) => v / 1000), y: history("north_m").map((v) => v / 1000),
        line: { color: controller.color, width: 1.8 } }], layout("east (km)", "north (km)", { height: 300 }), config);
    }
  };

  const draw = () => { drawScatter(); drawStrips(); drawTable(); drawFlight(); };
  const show = (row) => {
    state.current = row;
    draw();
    at("flight-panel").scrollIntoView({ block: "nearest" });
  };

  for (const entry of data.channels) at("flight-channel").append(new Option(labelOf(entry), entry.name, false, entry.name === data.start.channel));
  at("flight-channel").addEventListener("change", drawFlight);
  for (const id of ["scatter-x", "scatter-y"]) at(id).addEventListener("change", drawScatter);
  at("flights-controls").addEventListener("submit", (event) => event.preventDefault());
  data.controllers.forEach((controller, k) => {
    const box = Object.assign(document.createElement("input"), { type: "checkbox", checked: true, name: `flights-${controller.name}` });
    const label = document.createElement("label");
    label.append(box, ` ${controller.label}`);
    at("flights-controllers").append(label);
    box.addEventListener("change", () => { if (box.checked) state.controllers.add(k); else state.controllers.delete(k); draw(); });
  });
  at("flights-outcome").addEventListener("change", () => { state.outcome = at("flights-outcome").value; draw(); });
  at("flights-clear").addEventListener("click", () => { state.brush = null; draw(); });
  // For keyboards: the flights whose x lies between two numbers.
  at("flights-between").addEventListener("click", () => {
    const [low, high] = ["flights-low", "flights-high"].map((id) => at(id).value);
    const values = column(at("scatter-x").value);
    state.brush = new Set([...Array(count).keys()].filter((row) =>
      (low === "" || values[row] >= Number(low)) && (high === "" || values[row] <= Number(high))));
    draw();
  });
  for (const strip of document.querySelectorAll("canvas[data-dispersion]")) {
    let from = null;
    const value = (event) => {
      const { low, high } = data.places[`column:${strip.dataset.dispersion}`];
      return low + (high - low) * (event.offsetX - 3) / (strip.clientWidth - 6);
    };
    strip.addEventListener("pointerdown", (event) => { from = value(event); strip.setPointerCapture(event.pointerId); });
    strip.addEventListener("pointerup", (event) => {
      const [low, high] = [from, value(event)].sort((a, b) => a - b);
      const values = column(strip.dataset.dispersion);
      const members = [...Array(count).keys()].filter((row) => values[row] >= low && values[row] <= high);
      state.brush = high - low > 0 && members.length ? new Set(members) : null;
      draw();
    });
  }
  at("flights-view").hidden = false;
  draw();
  at("scatter").on("plotly_click", (event) => show(event.points[0].customdata));
  at("scatter").on("plotly_selected", (event) => {
    if (!event) return;
    state.brush = event.points.length ? new Set(event.points.map((point) => point.customdata)) : null;
    drawStrips(); drawTable(); drawScatter();
  });
  addEventListener("resize", drawStrips);
  for (const link of document.querySelectorAll("[data-metric]")) {
    link.addEventListener("click", () => {
      at("scatter-y").value = link.dataset.metric;
      drawScatter();
      at("scatter").scrollIntoView({ block: "center" });
    });
  }
  for (const table of document.querySelectorAll("#flights details tbody")) oneStop(table)();
  // Other places of the page name flights: data-show="controller flight".
  for (const link of document.querySelectorAll("[data-show]")) {
    link.addEventListener("click", () => {
      const [who, number] = link.dataset.show.split(" ");
      const row = rows.flight.findIndex((flight, i) => flight === Number(number) && data.controllers[rows.controller[i]].name === who);
      if (row >= 0) show(row);
    });
  }
  return { draw, show, state };
};
