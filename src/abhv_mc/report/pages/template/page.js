"use strict";
(() => {
  const data = JSON.parse(document.getElementById("envelope-data").textContent);
  const plot = document.getElementById("plot");
  const words = document.getElementById("plot-words");
  const channelBox = document.getElementById("channel");
  const layers = [
    { name: "all", label: "all flights", low: "min", high: "max", opacity: 0.14, on: true },
    { name: "wide", label: "0.135–99.865 %", low: "q0.135", high: "q99.865", opacity: 0.22, on: true },
    { name: "narrow", label: "5–95 %", low: "q5", high: "q95", opacity: 0.32, on: true },
    { name: "median", label: "median", on: true },
    { name: "nominal", label: "nominal flight", on: false },
    { name: "command", label: "command (median)", on: true },
    { name: "reference", label: "reference", on: true },
  ];

  // Named one by one: the library's own set has a button that uploads the plot's data.
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
  const isOn = (name) => layers.find((layer) => layer.name === name).box.checked;
  const shownControllers = () => data.controllers.filter((controller) => controller.box.checked);

  const bandTraces = (controller, curves) =>
    layers.filter((layer) => layer.low && layer.box.checked).flatMap((layer) => {
      const common = { x: controller.time, mode: "lines", line: { width: 0.6, color: rgba(controller.color, 0.5) },
        legendgroup: controller.name, showlegend: false };
      return [
        { ...common, y: curves[layer.low], name: `${controller.label} ${layer.low === "min" ? "smallest" : layer.low.slice(1) + " %"}` },
        { ...common, y: curves[layer.high], name: `${controller.label} ${layer.high === "max" ? "largest" : layer.high.slice(1) + " %"}`,
          fill: "tonexty", fillcolor: rgba(controller.color, layer.opacity) },
      ];
    });

  const lineTraces = (controller, curves, channel) => {
    const line = (y, name, dash, width) => ({ x: controller.time, y, name: `${controller.label} ${name}`, mode: "lines",
      line: { color: controller.color, dash, width }, legendgroup: controller.name });
    const traces = [];
    if (isOn("median")) traces.push(line(curves.q50, "median", "solid", 2.4));
    if (isOn("nominal") && curves.nominal) traces.push(line(curves.nominal, "nominal", "dash", 1.8));
    if (isOn("command") && channel.command) traces.push(line(controller.curves[channel.command].q50, "command", "dot", 1.8));
    return traces;
  };

  const describe = (channel, controllers) => {
    const range = (controller) => {
      const curves = controller.curves[channel.name];
      const low = Math.min(...curves.min.filter((v) => v !== null));
      const high = Math.max(...curves.max.filter((v) => v !== null));
      const text = (value) => String(Number(value.toPrecision(4))).replace("-", "\u2212");
      return `${controller.label} ${text(low)} to ${text(high)} ${channel.unit}`.trim();
    };
    words.textContent = controllers.length
      ? `${channel.label} (${channel.doc}) over all flights and times: ${controllers.map(range).join("; ")}. Bands hold at each moment by itself, over the flights that still fly then.`
      : "No controller is chosen.";
  };

  function draw() {
    const channel = data.channels[channelBox.selectedIndex];
    const controllers = shownControllers();
    const traces = [];
    for (const controller of controllers) traces.push(...bandTraces(controller, controller.curves[channel.name]));
    for (const controller of controllers) traces.push(...lineTraces(controller, controller.curves[channel.name], channel));
    if (isOn("reference") && data.reference[channel.reference]) {
      traces.push({ x: data.reference.time, y: data.reference[channel.reference], name: "reference", mode: "lines",
        line: { color: getComputedStyle(document.documentElement).getPropertyValue("--ink").trim(), width: 1.2 } });
    }
    const narrow = plot.clientWidth < 560;
    const style = getComputedStyle(document.documentElement);
    const ink = style.getPropertyValue("--ink").trim();
    const line = style.getPropertyValue("--line").trim();
    Plotly.react(plot, traces, {
      margin: { l: narrow ? 52 : 70, r: 12, t: 10, b: 46 },
      xaxis: { title: { text: "time (s)" }, zeroline: false, gridcolor: line },
      yaxis: { title: { text: channel.unit ? `${channel.label} (${channel.unit})` : channel.label }, zeroline: false, exponentformat: "none", gridcolor: line },
      hovermode: narrow ? "closest" : "x unified",
      legend: { orientation: "h", y: -0.16 },
      font: { family: "system-ui, Segoe UI, Liberation Sans, Arial, sans-serif", size: 13, color: ink }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      hoverlabel: { bgcolor: style.getPropertyValue("--paper").trim(), font: { color: ink } },
      height: narrow ? 400 : 480,
      uirevision: channel.name,
    }, { responsive: true, displaylogo: false, plotlyServerURL: "", modeBarButtons: [tools] });
    describe(channel, controllers);
  }

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
  const controls = document.getElementById("controls");
  controls.addEventListener("submit", (event) => event.preventDefault());

  // The plotting library travels compressed; unpacked, it runs like any script of the page.
  const unpack = async () => {
    const letters = atob(document.getElementById("plotly-packed").textContent);
    const bytes = Uint8Array.from(letters, (letter) => letter.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    const script = document.createElement("script");
    script.textContent = await new Response(stream).text();
    document.head.append(script);
  };
  const start = async () => {
    await unpack();
    controls.hidden = false;
    if (data.channels.length) draw();
    dispatchEvent(new Event("drawn"));
  };
  if (typeof DecompressionStream === "undefined") {
    words.textContent = "This browser is too old for the interactive envelopes; the figures below show the same bands.";
  } else {
    start();
  }

  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { if (!controls.hidden) draw(); });
})();
