// Panel of one or two opened flights: text, limits, time history, ground track and 3D path.
const flightPanel = (source, style, { columnOf, nameOf, changed }) => {
  const at = (id) => document.getElementById(id);
  const { text, fixed, labelOf } = flightAxes;
  const { view } = source;
  const { controllers } = view;
  const rows = view.requirements.length ? view.requirements
    : view.headed.map((name) => ({ metric: name, words: columnOf(name).label, low: null, high: null }));
  let flights = [];
  let channel = null;

  // Dispersions as text such as 'drag −15.0 %, lift −8.4 %', sorted by distance from the mean.
  const MOST = 8;
  const dispersionWords = ({ values }) => {
    const drawn = view.columns.filter((entry) => entry.spoken);
    const far = ({ name, mean, sigma }) => (sigma && Number.isFinite(values[name]) ? Math.abs(values[name] - mean) / sigma : 0);
    const shown = ({ name, spoken, unit, factor, never }) => {
      const value = values[name];
      if (!Number.isFinite(value)) return `${spoken} ${never}`;
      if (!factor) return `${spoken} ${text(value, 3)}${unit ? `\u00a0${unit}` : ""}`;
      const change = (100 * (value - 1)).toFixed(1);
      return `${spoken} ${value > 1 && change !== "0.0" ? "+" : ""}${change.replace("-", "\u2212")}\u00a0%`;
    };
    const words = drawn.sort((a, b) => far(b) - far(a)).map(shown);
    return words.length > MOST ? `${words.slice(0, MOST).join(", ")} and ${words.length - MOST} more` : words.join(", ");
  };

  // Margin of a value to its limits, relative to the limit or, with two limits, to half of their distance.
  const room = ({ low, high }, value) => {
    if (low !== null && high !== null) return Math.min(high - value, value - low) / ((high - low) / 2);
    return high !== null ? (high - value) / Math.abs(high) : low !== null ? (value - low) / Math.abs(low) : NaN;
  };
  const roomWords = (requirement, value, missed) => {
    const share = room(requirement, value);
    if (missed && !(share < 0)) return share >= 0 ? "missed: terminated early" : "missed";
    const words = Number.isFinite(share) ? `${text(100 * Math.abs(share), 2)}\u00a0% ${share < 0 ? "over" : "margin"}` : "";
    return missed ? `missed, ${words}` : words;
  };

  const fillRequired = () => {
    const [head] = [at("flight-required").tHead];
    head.replaceChildren();
    const line = head.insertRow();
    for (const words of [view.requirements.length ? "Requirement" : "Metric", ...flights.map((each) => nameOf(each.controller, each.flight))]) {
      line.append(Object.assign(document.createElement("th"), { scope: "col", textContent: words }));
    }
    const [body] = at("flight-required").tBodies;
    body.replaceChildren();
    rows.forEach((requirement, k) => {
      const row = body.insertRow();
      row.append(Object.assign(document.createElement("th"), { scope: "row", textContent: requirement.words }));
      const { unit } = columnOf(requirement.metric);
      for (const each of flights) {
        const value = each.values[requirement.metric] ?? NaN;
        const missed = each.missed[k] ?? false;
        const cell = row.insertCell();
        cell.textContent = `${fixed(value)}${unit ? `\u00a0${unit}` : ""} `;
        cell.append(Object.assign(document.createElement("span"), { className: missed ? "poor" : "bounds", textContent: roomWords(requirement, value, missed) }));
      }
    });
  };

  const fillChannels = (held) => {
    const known = view.channels.filter(({ name }) => held.includes(name));
    at("flight-channel").replaceChildren(...known.map((entry) => new Option(labelOf(entry), entry.name)));
    // Channel whose limit ended the flight early ('sideslip limit'), if there is such a channel.
    const [ended] = known.filter(({ label }) => flights[0].outcome.startsWith(label.toLowerCase())).sort((a, b) => b.label.length - a.label.length);
    const worst = ended?.name ?? view.criteria[flights[0].by]?.channel;
    if (!known.some(({ name }) => name === channel)) channel = known.some(({ name }) => name === worst) ? worst : known[0]?.name;
    at("flight-channel").value = channel;
  };

  const narrow = () => at("flight-history").clientWidth < 560; // narrow legends use one line per entry
  const layout = (x, y) => ({
    margin: { l: 60, r: 10, t: 8, b: 42 }, hovermode: "closest", paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: { family: style.font, size: 12, color: style.ink() }, legend: { orientation: "h", y: narrow() ? -0.42 : -0.22 },
    modebar: { bgcolor: "rgba(0,0,0,0)", color: style.ink(), activecolor: style.link() },
    hoverlabel: { bgcolor: style.paper(), font: { color: style.ink() } },
    xaxis: { title: { text: x }, gridcolor: style.line(), zeroline: false },
    yaxis: { title: { text: y }, gridcolor: style.line(), zeroline: false, exponentformat: "none" },
  });
  const config = { responsive: true, displaylogo: false, plotlyServerURL: "", modeBarButtons: [["zoom2d", "pan2d", "resetScale2d", "toImage"]] };
  // Each flight has the colour of its controller; a second flight of the same controller is drawn in the text colour.
  const lookOf = (i) => ({ width: 1.8, color: i && flights[1].controller === flights[0].controller ? style.ink() : controllers[flights[i].controller].color });
  const shortName = (each) => `${controllers[each.controller].label} ${each.flight}`;

  const behindTraces = (each, behind, i) => {
    if (!behind) return [];
    const { color } = controllers[each.controller];
    const band = (low, high, words, opacity) => (behind[low]?.some(Number.isFinite) ? [low, high].map((name, end) => ({ type: "scatter", mode: "lines", x: behind.time, y: behind[name],
      line: { width: 0 }, hoverinfo: "skip", legendgroup: `${words} ${i}`, showlegend: end === 1, name: `${controllers[each.controller].label}, ${words}`,
      ...(end ? { fill: "tonexty", fillcolor: `${color}${opacity}` } : {}) })) : []);
    const nominal = { type: "scatter", mode: "lines", x: behind.time, y: behind.nominal, name: `${controllers[each.controller].label}, nominal`, line: { color, width: 1.2, dash: "dash" } };
    return [...band("min", "max", "all flights", "22"), ...band("q5", "q95", "5–95 %", "44"), ...(behind.nominal?.some(Number.isFinite) ? [nominal] : [])];
  };
  // Points of a horizontal line over the time window of a metric, with gaps at the transients that the metric excludes.
  const pieces = ({ from, to, settled }, end, level) => {
    const last = Math.min(to ?? Infinity, end);
    const gaps = settled ? view.transients.filter(([first]) => first < last) : [];
    const x = [from, ...gaps.flatMap(([first, back]) => [first, null, Math.min(back, last)]), last];
    return { x, y: x.map((time) => (time === null ? null : level)) };
  };
  const limitTraces = (time) => view.criteria.filter((each) => each.channel === channel).flatMap((each) =>
    columnOf(each.metric).limits.flatMap((limit) => each.sides.map((side) => side * limit)).map((level, i) => ({
      type: "scatter", mode: "lines", ...pieces(each, time.at(-1), level), name: `limit of ${columnOf(each.metric).label}`,
      legendgroup: each.metric, showlegend: i === 0, line: { color: style.ink(), width: 1.5, dash: "6px,4px" } })));

  const draw = async () => {
    if (!flights.length) return;
    const flown = flights.filter((each) => each.history);
    at("flight-plots").hidden = !flown.length;
    if (!flown.length) return;
    fillChannels(Object.keys(flown[0].history.channels));
    const entry = view.channels.find(({ name }) => name === channel);
    const shown = flights.map((each, i) => [each, i]).filter(([each]) => each.history?.channels[channel]);
    const apart = shown.filter(([each], i) => shown.findIndex(([other]) => other.controller === each.controller) === i);
    const wanted = channel;
    const behind = await Promise.all(apart.map(([each]) => source.behind(each.controller, channel)));
    if (wanted !== channel) return;
    const traces = apart.flatMap(([each, i], n) => behindTraces(each, behind[n], i));
    at("flight-bands").hidden = behind.every((each) => each?.q5?.some(Number.isFinite));
    at("flight-bands").textContent = view.banded ? `No bands of ${channel} are stored. To store them, add the channel to keep: envelopes: channels.` : "";
    for (const [each, i] of shown) {
      const { time, channels } = each.history;
      const line = (y, name, dash) => ({ type: "scatter", mode: "lines", x: time, y, name, line: { ...lookOf(i), dash } });
      traces.push(line(channels[channel], shortName(each), "solid"));
      if (channels[entry.command]) traces.push(line(channels[entry.command], `${shortName(each)}, command`, "dot"));
    }
    traces.push(...limitTraces(shown.map(([each]) => each.history.time).reduce((a, b) => (a.at(-1) > b.at(-1) ? a : b))));
    Plotly.react("flight-history", traces, layout("time (s)", labelOf(entry)), config);
    const tracked = flown.filter(({ history: { channels } }) => channels.north_m && channels.east_m);
    at("flight-track").hidden = !tracked.length;
    at("flight-track").parentElement.classList.toggle("alone", !tracked.length);
    if (tracked.length) {
      const km = (values) => values.map((value) => value / 1000);
      Plotly.react("flight-track", tracked.map((each) => ({ type: "scatter", mode: "lines", name: shortName(each), line: lookOf(flights.indexOf(each)),
        x: km(each.history.channels.east_m), y: km(each.history.channels.north_m) })), layout("east (km)", "north (km)"), config);
    }
  };

  const path = flightPath(at("flight-path"), style);
  const show = async (given, wanted) => {
    flights = given;
    channel = wanted;
    const [first, second] = flights;
    const title = (each) => `${nameOf(each.controller, each.flight)}: ${each.outcome}`;
    at("flight-title").textContent = title(first) + (second ? `, overlaid with ${title(second)}` : "");
    at("flight-words").textContent = [first, ...(second && (second.flight !== first.flight) ? [second] : [])]
      .map((each) => `${second ? `Flight ${each.flight}: ` : ""}${dispersionWords(each)}`).join(". ");
    ["flight-command", "over-command"].forEach((id, i) => {
      const each = flights[i];
      at(id).hidden = !each;
      if (each) at(id).textContent = `abhv-mc replay ${view.folder} --flight ${each.flight} --controller ${controllers[each.controller].name}`;
    });
    at("flight-again").hidden = !view.flies;
    const notes = flights.map((each) => (each.note && second ? `${shortName(each)}: ${each.note}` : each.note));
    at("flight-note").textContent = notes.join(" ").trim();
    at("over-none").hidden = !second;
    const over = second ?? { controller: (first.controller + 1) % controllers.length, flight: first.flight };
    at("over-controller").value = controllers[over.controller].name;
    at("over-flight").value = over.flight;
    fillRequired();
    await draw();
    path.show(flights.filter((each) => each.history).map((each) => ({ history: each.history, name: shortName(each), color: lookOf(flights.indexOf(each)).color })));
  };
  at("flight-channel").addEventListener("change", () => { channel = at("flight-channel").value; changed(channel); draw(); });
  return { show, draw: () => { draw(); path.draw(); } };
};
