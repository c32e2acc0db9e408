(() => {
  const page = JSON.parse(document.getElementById("page-data").textContent);
  const data = page.envelopes;
  const unpack = async (id) => {
    const bytes = Uint8Array.from(atob(document.getElementById(id).textContent), (letter) => letter.charCodeAt(0));
    return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip")));
  };
  // Decode packed numbers: 16 bits for the difference from the previous number, low bytes first.
  let codes = null;
  const decoded = new Map();
  const numbers = (name, row = null) => {
    const key = `${name}/${row}`;
    if (!decoded.has(key)) {
      const { start, shape, low, high } = page.places[name];
      const size = row === null ? shape.reduce((a, b) => a * b, 1) : shape[shape.length - 1];
      const from = start + (row ?? 0) * size;
      const total = codes.length / 2;
      const values = new Array(size);
      for (let i = 0, n = 0; i < size; i += 1) {
        n = (n + codes[from + i] + 256 * codes[total + from + i]) & 65535;
        values[i] = n === 65535 ? NaN : low + ((high - low) * n) / 65534;
      }
      decoded.set(key, values);
    }
    return decoded.get(key);
  };
  const curve = (controller, channel, band) => numbers(`${channel}:${controller.name}`, data.bands.indexOf(band));
  const timeOf = (controller) => numbers(`time:${controller.name}`);
  const plot = document.getElementById("plot");
  const words = document.getElementById("plot-words");
  const channelBox = document.getElementById("channel");
  const layers = [
    { name: "all", label: "all flights", low: "min", high: "max", opacity: 0.14, on: true },
    { name: "wide", label: "0.135–99.865 %", low: "q0.135", high: "q99.865", opacity: 0.22, on: true },
    { name: "narrow", label: "5–95 %", low: "q5", high: "q95", opacity: 0.32, on: true },
    { name: "median", label: "median", on: true },
    ...(data.nominal ? [{ name: "nominal", label: "nominal flight", on: false }] : []),
    ...(data.channels.some(({ command }) => command) ? [{ name: "command", label: "command (median)", on: false }] : []),
    ...(data.channels.some(({ reference }) => reference) ? [{ name: "reference", label: "reference", on: true }] : []),
  ];

  // The buttons are listed individually, because the library's default set has a button that uploads the plotted data.
  const tools = ["toImage", "zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "autoScale2d", "resetScale2d"];

  const addBox = (parent, name, label, checked) => {
    const box = document.createElement("input");
    box.type = "checkbox";
    box.name = name;
    box.checked = checked;
    const text = document.createElement("label");
    text.append(box, ` ${label}`);
    document.getElementById(parent).append(text);
    box.addEventListener("change", draw);
    return box;
  };

  const rgba = (hex, opacity) => {
    const part = (i) => parseInt(hex.slice(i, i + 2), 16);
    return `rgba(${part(1)},${part(3)},${part(5)},${opacity})`;
  };
  const isOn = (name) => layers.find((layer) => layer.name === name)?.box.checked;
  const shownControllers = () => data.controllers.filter((controller) => controller.box.checked);

  // As in the printed figures, the first controller is a solid line on top; the lines below it are wider and dashed.
  const dashes = ["solid", "9px,3px", "3px,2px", "9px,3px,2px,3px"];
  const lookOf = (controller) => {
    const k = data.controllers.indexOf(controller);
    return { color: controller.color, width: k ? 3 : 2, dash: dashes[k % dashes.length] };
  };

  const bandTraces = (controller, channel) =>
    layers.filter((layer) => layer.low && layer.box.checked).flatMap((layer) => {
      const common = { x: timeOf(controller), mode: "lines", line: { width: 0.6, color: rgba(controller.color, 0.5) },
        legendgroup: controller.name, showlegend: false };
      return [
        { ...common, y: curve(controller, channel.name, layer.low), name: `${controller.label} ${layer.low === "min" ? "smallest" : layer.low.slice(1) + " %"}` },
        { ...common, y: curve(controller, channel.name, layer.high), name: `${controller.label} ${layer.high === "max" ? "largest" : layer.high.slice(1) + " %"}`,
          fill: "tonexty", fillcolor: rgba(controller.color, layer.opacity) },
      ];
    });

  const lineTraces = (controller, channel) => {
    const line = (y, name, look = {}) => ({ x: timeOf(controller), y, name: `${controller.label} ${name}`, mode: "lines",
      line: { ...lookOf(controller), ...look }, legendgroup: controller.name, legendrank: data.controllers.indexOf(controller) });
    const traces = [];
    if (isOn("median")) {
      if (data.bands.includes("q50_most")) {
        traces.push(line(curve(controller, channel.name, "q50"), "least median"));
        traces.push(line(curve(controller, channel.name, "q50_most"), "most median"));
      } else traces.push(line(curve(controller, channel.name, "q50"), "median"));
    }
    if (isOn("nominal")) traces.push(line(curve(controller, channel.name, "nominal"), "nominal", { width: 1, dash: "dash" }));
    if (isOn("command") && channel.command) traces.push(line(curve(controller, channel.command, "q50"), "command", { width: 1.5, dash: "1px,3px" }));
    return traces;
  };

  const describe = (channel, controllers) => {
    const range = (controller) => {
      const low = Math.min(...curve(controller, channel.name, "min").filter(Number.isFinite));
      const high = Math.max(...curve(controller, channel.name, "max").filter(Number.isFinite));
      const text = (value) => String(Number(value.toPrecision(4))).replace("-", "\u2212");
      return `${controller.label} ${text(low)} to ${text(high)} ${channel.unit}`.trim();
    };
    words.textContent = controllers.length
      ? `${channel.label} (${channel.doc}) over all flights and times: ${controllers.map(range).join("; ")}.`
      : "No controller is selected.";
  };

  function draw() {
    const channel = data.channels[channelBox.selectedIndex];
    const controllers = shownControllers();
    const traces = [];
    const upwards = [...controllers].reverse();
    for (const controller of upwards) traces.push(...bandTraces(controller, channel));
    for (const controller of upwards) traces.push(...lineTraces(controller, channel));
    let light = 1; // share of the background that is visible through the overlapping bands
    for (const { label, opacity } of layers.filter((layer) => layer.low && layer.box.checked)) {
      light *= 1 - opacity;
      traces.push({ x: [null], y: [null], name: label, mode: "none", fill: "toself", fillcolor: `rgba(128,128,128,${1.3 * (1 - light)})`, legendrank: 2000 });
    }
    if (isOn("reference") && channel.reference) {
      traces.push({ x: numbers("reference:time"), y: numbers(`reference:${channel.reference}`), name: "reference", mode: "lines", legendrank: 1000,
        line: { color: getComputedStyle(document.documentElement).getPropertyValue("--ink").trim(), width: 1.2 } });
    }
    const narrow = plot.clientWidth < 560;
    // The legend is below the axis label; on a narrow page, each entry has its own line.
    const entries = traces.filter((trace) => trace.showlegend !== false).length;
    const area = narrow ? 300 : 350;
    const below = 52 + 20 * (narrow ? entries : Math.ceil((entries * 140) / plot.clientWidth));
    const style = getComputedStyle(document.documentElement);
    const ink = style.getPropertyValue("--ink").trim();
    const line = style.getPropertyValue("--line").trim();
    plot.style.height = `${area + below + 10}px`; // The height of the element is set, because a height in the layout is lost when the page is resized.
    Plotly.react(plot, traces, {
      margin: { l: narrow ? 52 : 70, r: 12, t: 10, b: below },
      xaxis: { title: { text: "time (s)", standoff: 4 }, zeroline: false, gridcolor: line },
      yaxis: { title: { text: channel.unit ? `${channel.label} (${channel.unit})` : channel.label }, zeroline: false, exponentformat: "none", gridcolor: line },
      hovermode: narrow ? "closest" : "x unified",
      legend: { orientation: "h", y: -42 / area, yanchor: "top", traceorder: "normal" },
      font: { family: "system-ui, Segoe UI, Liberation Sans, Arial, sans-serif", size: 13, color: ink }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      hoverlabel: { bgcolor: style.getPropertyValue("--paper").trim(), font: { color: ink } },
      modebar: { bgcolor: "rgba(0,0,0,0)", color: ink, activecolor: style.getPropertyValue("--link").trim() },
      uirevision: channel.name,
    }, { responsive: true, displaylogo: false, plotlyServerURL: "", modeBarButtons: [tools] });
    describe(channel, controllers);
  }

  const controls = document.getElementById("controls"); // null if the campaign stores no envelopes
  if (controls) {
    for (const channel of data.channels) {
      const option = document.createElement("option");
      option.value = channel.name;
      option.textContent = channel.unit ? `${channel.label} (${channel.unit})` : channel.label;
      channelBox.append(option);
    }
    data.controllers.forEach((controller) => { controller.box = addBox("controllers-boxes", controller.name, controller.label, true); });
    layers.forEach((layer) => { layer.box = addBox("layers-boxes", layer.name, layer.label, layer.on); });
    const first = data.channels.findIndex((channel) => channel.name === "bank_deg");
    channelBox.selectedIndex = Math.max(first, 0);
    channelBox.addEventListener("change", draw);
    controls.addEventListener("submit", (event) => event.preventDefault());
  }

  // The page contains the plotting library in compressed form; it is decompressed and run as a script.
  const start = async () => {
    const script = document.createElement("script");
    script.textContent = await (await unpack("plotly-packed")).text();
    document.head.append(script);
    codes = new Uint8Array(await (await unpack("arrays-packed")).arrayBuffer());
    if (controls) {
      controls.hidden = false;
      if (data.channels.length) draw();
    }
    const color = (name) => () => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    const style = { font: "system-ui, Segoe UI, Liberation Sans, Arial, sans-serif", ink: color("--ink"), line: color("--line"), link: color("--link"), paper: color("--paper") };
    flights = await flightsView(pageFlights(page.flights, page.places, data.bands, numbers), style);
    linkFlights();
    dispatchEvent(new Event("drawn"));
  };
  let flights = null;
  // Link the elements of the page that refer to flights (data-show="controller flight") or to metrics.
  const linkFlights = () => {
    for (const link of document.querySelectorAll("[data-metric]")) link.addEventListener("click", () => flights.across(link.dataset.metric));
    for (const table of document.querySelectorAll("#flights details tbody")) flights.oneStop(table)();
    for (const link of document.querySelectorAll("[data-show]")) {
      const [who, number] = link.dataset.show.split(" ");
      link.addEventListener("click", () => flights.open(who, Number(number)));
    }
  };
  if (typeof DecompressionStream === "undefined") {
    if (words) words.textContent = "This browser does not support the interactive envelopes; the figures below show the same bands.";
  } else {
    start();
  }

  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { if (controls && !controls.hidden) draw(); flights?.draw(); });
})();
