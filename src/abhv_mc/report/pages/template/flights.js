// View of flights in a report and in `explore`: selection, table, link, CSV and single flights. `source` supplies the
// counts, from numbers in the page or from a server.
const flightsView = async (source, style) => {
  const at = (id) => document.getElementById(id);
  const { text, fixed, labelOf } = flightAxes;
  const view = source.view;
  const { columns, controllers } = view;
  for (const controller of controllers) controller.path = new Path2D(controller.mark);
  const columnOf = (name) => columns.find((entry) => entry.name === name);
  const start = () => ({ x: view.x, y: view.y, who: controllers.map((each) => each.name), show: "all", brushes: {}, fit: false,
    sort: "rank", down: false, open: [], channel: null });
  const state = start();
  let [found, all, box, opened, turn] = [null, null, null, [], 0];
  const asked = () => ({ x: state.x, y: state.y, controllers: state.who, outcome: state.show, brushes: state.brushes,
    fit: state.fit, sort: state.sort, down: state.down });
  const grouped = (number) => // same format as in the tables of the page
    number < 10000 ? String(number) : number.toLocaleString("en").replaceAll(",", "\u202f");
  const nameOf = (k, flight) => `${controllers[k].label}, flight ${flight}`;

  // The address fragment that stores the selection, and the selection that a fragment describes.
  const link = () => {
    const words = new URLSearchParams();
    for (const [key, name] of [["x", "x"], ["y", "y"], ["show", "show"], ["sort", "sort"]]) if (state[key] !== start()[key]) words.set(name, state[key]);
    if (state.who.length !== controllers.length) words.set("who", JSON.stringify(state.who));
    for (const key of ["fit", "down"]) if (state[key]) words.set(key, "1");
    for (const [name, ends] of Object.entries(state.brushes)) words.append("in", [name, ...ends.map((end) => Number(end.toPrecision(7)))].join(":"));
    for (const [controller, flight] of state.open) words.append("open", `${flight}:${controller}`);
    if (state.channel) words.set("channel", state.channel);
    return `#flights?${words}`;
  };
  const follow = () => {
    if (!location.hash.startsWith("#flights?")) return false;
    const words = new URLSearchParams(location.hash.slice("#flights?".length));
    Object.assign(state, start());
    for (const [key, known] of [["x", columnOf], ["y", columnOf], ["sort", (v) => heads.some(([name]) => name === v)],
      ["show", (v) => [...at("flights-outcome").options].some((option) => option.value === v)],
      ["channel", (v) => view.channels.some((each) => each.name === v)]]) {
      if (words.has(key) && known(words.get(key))) state[key] = words.get(key);
    }
    if (words.has("who")) state.who = controllers.map((each) => each.name).filter((name) => JSON.parse(words.get("who")).includes(name));
    for (const key of ["fit", "down"]) state[key] = words.get(key) === "1";
    for (const [name, ...ends] of words.getAll("in").map((part) => part.split(":"))) {
      if (columnOf(name) && ends.every((end) => Number.isFinite(Number(end)))) state.brushes[name] = ends.map(Number);
    }
    state.open = words.getAll("open").slice(0, 2).map((part) => [part.slice(part.indexOf(":") + 1), parseInt(part, 10)])
      .filter(([name, flight]) => controllers.some((each) => each.name === name) && flight >= 0);
    return true;
  };

  // The Tab key stops once at a list of buttons; the arrow keys move within the list.
  const oneStop = (list) => {
    const buttons = () => [...list.querySelectorAll("button")];
    const stop = (chosen) => { for (const button of buttons()) button.tabIndex = button === chosen ? 0 : -1; };
    list.addEventListener("focusin", (event) => stop(event.target));
    list.addEventListener("keydown", (event) => {
      const every = buttons();
      const here = every.indexOf(document.activeElement);
      const next = { ArrowDown: here + 1, ArrowRight: here + 1, ArrowUp: here - 1, ArrowLeft: here - 1, Home: 0, End: every.length - 1 }[event.key];
      if (next === undefined) return;
      event.preventDefault();
      every[next]?.focus();
    });
    return () => stop(buttons()[0]);
  };
  const restop = oneStop(at("flight-rows"));

  const heads = [["flight", "Flight"], ...(controllers.length > 1 ? [["controller", view.kind]] : []), ["outcome", "Outcome"],
    ...view.headed.map((name) => [name, labelOf(columnOf(name))])];
  for (const [name, words] of heads) {
    const head = Object.assign(document.createElement("th"), { scope: "col" });
    const button = Object.assign(document.createElement("button"), { type: "button", className: "link", textContent: words });
    const first = columnOf(name) ? columnOf(name).bad !== "low" : false; // The first click sorts bad values first, the second reverses the order, the third sorts by severity.
    button.addEventListener("click", () => {
      if (state.sort !== name) [state.sort, state.down] = [name, first];
      else if (state.down === first) state.down = !first;
      else [state.sort, state.down] = ["rank", false];
      count();
    });
    head.append(button);
    at("flight-heads").append(head);
  }
  oneStop(at("flight-heads"))();
  if (view.histories) at("flight-heads").append(Object.assign(document.createElement("th"), { scope: "col", textContent: "History" }));

  const drawTable = () => {
    const body = at("flight-rows");
    const focused = body.contains(document.activeElement);
    body.replaceChildren();
    const order = state.sort === "rank" ? "worst" : "first";
    at("flight-count").textContent = `${grouped(found.count)} of ${grouped(view.total)} ${view.total === 1 ? "flight" : "flights"}` +
      `${found.count > view.listed ? `; the ${order} ${view.listed} are listed` : ""}${found.points.length || !found.count ? "" : "; shades count flights"}${view.left ? `. ${view.left}` : ""}.`;
    heads.forEach(([name], i) => {
      const cell = at("flight-heads").cells[i];
      if (name === state.sort) cell.ariaSort = state.down ? "descending" : "ascending"; else cell.removeAttribute("aria-sort");
    });
    for (const [k, flight, outcome, ...values] of found.rows) {
      const line = body.insertRow();
      const button = Object.assign(document.createElement("button"), { type: "button", textContent: flight });
      button.setAttribute("aria-label", `Show ${nameOf(k, flight)}`);
      button.addEventListener("click", (event) => open(controllers[k].name, flight, event.shiftKey));
      const head = Object.assign(document.createElement("th"), { scope: "row" });
      head.append(button);
      line.append(head);
      if (state.open.some(([name, number]) => name === controllers[k].name && number === flight)) line.className = "current";
      for (const words of [...(controllers.length > 1 ? [controllers[k].label] : []), outcome, ...values.map((value) => (typeof value === "string" ? value : fixed(value)))]) line.insertCell().textContent = words;
    }
    restop();
    if (focused) (body.querySelector(".current button") || body.querySelector("button"))?.focus();
  };

  const draw = () => {
    if (!found) return;
    const [x, y] = [columnOf(state.x), columnOf(state.y)];
    const brushed = Object.keys(state.brushes).length > 0;
    box = flightAxes.drawScatter(at("scatter"), { x, y, ends: found.ends, controllers, cells: view.cells, style,
      layers: [...(brushed ? [[all, 0.12]] : []), [found, 0.8]],
      open: opened.map((each) => [each.controller, each.values[x.name], each.values[y.name]]) });
    for (const canvas of at("flights-strips").querySelectorAll("canvas")) {
      const name = canvas.dataset.column;
      flightAxes.drawStrip(canvas, { all: all.strips[name], chosen: found.strips[name], ends: columnOf(name).ends, bars: view.bars, style,
        open: opened.map((each) => each.values[name]) });
    }
    drawTable();
    at("flights-link").href = link();
    document.body.dataset.drawn = turn;
  };
  const count = async () => {
    const number = (turn += 1);
    const [chosen, every] = await Promise.all([source.count(asked()), source.count({ ...asked(), brushes: {}, fit: false, sort: "rank", down: false })]);
    if (number !== turn) return; // a newer selection replaces this one
    [found, all] = [chosen, every];
    draw();
  };

  const panel = flightPanel(source, style, { columnOf, nameOf, changed: (channel) => { state.channel = channel; at("flights-link").href = link(); } });
  // Open a flight, or overlay a second flight.
  const open = async (name, flight, over = false) => {
    state.open = over && state.open.length ? [state.open[0], [name, flight]] : [[name, flight]];
    await show();
    at("flight-panel").scrollIntoView({ block: "nearest" });
  };
  const show = async () => {
    at("flight-panel").hidden = !state.open.length;
    const wanted = state.open;
    const flights = [];
    at("flight-body").hidden = !opened.length; // hidden until the flight has been computed
    for (const [name, flight] of wanted) {
      const k = controllers.findIndex((each) => each.name === name);
      if (!flights.length) at("flight-title").textContent = `${nameOf(k, flight)}: opening`;
      try {
        flights.push(await source.flight(k, flight));
      } catch (error) {
        at("flight-title").textContent = `${nameOf(k, flight)}: ${error.message}`;
        if (!flights.length) { opened = []; draw(); return; }
      }
    }
    if (wanted !== state.open) return;
    opened = flights;
    at("flight-body").hidden = false;
    draw();
    if (flights.length) await panel.show(flights, state.channel);
    document.body.dataset.opened = flights.map((each) => each.flight).join();
  };
  at("flight-over").addEventListener("submit", (event) => {
    event.preventDefault();
    open(at("over-controller").value, Number(at("over-flight").value), true);
  });
  at("over-none").addEventListener("click", () => { state.open = state.open.slice(0, 1); show(); });

  // Selection by the form, by dragging, or by a link.
  const dragged = (canvas, ended) => {
    let from = null;
    canvas.addEventListener("pointerdown", (event) => { from = [event.offsetX, event.offsetY]; canvas.setPointerCapture(event.pointerId); });
    canvas.addEventListener("pointerup", (event) => { if (from) ended(from, [event.offsetX, event.offsetY], event); from = null; });
  };
  const sorted = (one, other) => [one, other].sort((p, q) => p - q);
  // Return the drawn point that is nearest to a position, within a number of pixels.
  const pointAt = (px, py, within) => {
    let [best, near] = [null, within ** 2];
    for (const point of found?.points ?? []) {
      const away = (box.px(point[1]) - px) ** 2 + (box.py(point[2]) - py) ** 2;
      if (away < near) [best, near] = [point, away];
    }
    return best;
  };
  dragged(at("scatter"), async (a, b, event) => {
    if (Math.hypot(a[0] - b[0], a[1] - b[1]) < 4) {
      const point = pointAt(...b, 12);
      const near = point ? [point[0], point[3]] : found.points.length ? null : await source.nearest(asked(), box.x(b[0]), box.y(b[1]));
      if (near) open(controllers[near[0]].name, near[1], event.shiftKey);
      return;
    }
    state.brushes[state.x] = sorted(box.x(a[0]), box.x(b[0]));
    state.brushes[state.y] = sorted(box.y(a[1]), box.y(b[1]));
    count();
  });
  at("scatter").addEventListener("pointermove", (event) => {
    if (!box) return;
    const point = pointAt(event.offsetX, event.offsetY, 12);
    at("scatter-at").textContent = point ? `${nameOf(point[0], point[3])}: ${text(point[1])}, ${text(point[2])}` : "\u00a0";
  });
  for (const name of view.strips) {
    const strip = Object.assign(document.createElement("div"), { className: "strip" });
    const canvas = document.createElement("canvas");
    canvas.dataset.column = name;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `Values of ${labelOf(columnOf(name))} of the flights shown`);
    strip.append(Object.assign(document.createElement("span"), { textContent: labelOf(columnOf(name)) }), canvas);
    at("flights-strips").append(strip);
    dragged(canvas, (a, b) => {
      const [low, high] = columnOf(name).ends;
      const value = (place) => low + ((high - low) * place[0]) / canvas.clientWidth;
      if (a[0] === b[0]) delete state.brushes[name]; else state.brushes[name] = sorted(value(a), value(b));
      count();
    });
  }
  for (const [id, key] of [["scatter-x", "x"], ["scatter-y", "y"], ["flights-outcome", "show"]]) {
    at(id).addEventListener("change", () => { state[key] = at(id).value; count(); });
  }
  for (const entry of columns) for (const id of ["scatter-x", "scatter-y"]) at(id).append(new Option(labelOf(entry), entry.name));
  view.requirements.forEach((each, k) => at("flights-outcome").append(new Option(`missed: ${each.words}`, `missed ${k}`)));
  at("flights-kind").textContent = `${view.kind}s`;
  for (const controller of controllers) {
    const input = Object.assign(document.createElement("input"), { type: "checkbox", name: `flights-${controller.name}`, value: controller.name });
    const label = Object.assign(document.createElement("label"), { className: "name" });
    label.style.borderColor = controller.color;
    const mark = document.createElementNS("http://www.w3.org/2000/svg", "svg"); // the first controller has a filled mark, as in the plot
    mark.setAttribute("viewBox", "-6 -6 12 12");
    mark.innerHTML = `<path d="${controller.mark}" stroke="${controller.color}" fill="${controller === controllers[0] ? controller.color : "none"}"/>`;
    label.append(input, mark, ` ${controller.label}`);
    at("flights-controllers").append(label);
    at("over-controller").append(new Option(controller.label, controller.name));
    input.addEventListener("change", () => {
      state.who = [...at("flights-controllers").querySelectorAll(":checked")].map((each) => each.value);
      count();
    });
  }
  at("flights-controls").addEventListener("submit", (event) => event.preventDefault());
  at("flights-fit").addEventListener("change", () => { state.fit = at("flights-fit").checked; count(); });
  at("flights-clear").addEventListener("click", () => { state.brushes = {}; count(); });
  at("flights-between").addEventListener("click", () => { // Select the flights whose x lies between two numbers; this also works from the keyboard.
    const ends = ["flights-low", "flights-high"].map((id, i) => (at(id).value === "" ? columnOf(state.x).ends[i] : Number(at(id).value)));
    state.brushes[state.x] = sorted(...ends);
    count();
  });
  at("flights-csv").addEventListener("click", async () => {
    const save = Object.assign(document.createElement("a"), { download: "flights.csv", href: await source.csv(asked()) });
    save.click();
  });

  const fill = () => { // set the form from the state
    for (const [id, key] of [["scatter-x", "x"], ["scatter-y", "y"], ["flights-outcome", "show"]]) at(id).value = state[key];
    for (const input of at("flights-controllers").querySelectorAll("input")) input.checked = state.who.includes(input.value);
    at("flights-fit").checked = state.fit;
  };
  const restore = async () => {
    if (!follow()) return;
    fill();
    await count();
    await show();
    at("flights-view").scrollIntoView();
  };
  addEventListener("hashchange", restore);
  addEventListener("resize", draw);
  at("flights-view").hidden = false;
  fill();
  await count();
  await restore();
  return { draw: () => { draw(); panel.draw(); }, open, oneStop,
    across: (name) => { at("scatter-y").value = state.y = name; count(); at("scatter").scrollIntoView({ block: "center" }); } };
};
