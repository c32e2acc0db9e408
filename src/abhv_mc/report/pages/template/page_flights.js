// Data source of the view of flights in a report: counts, lists and histories from the numbers in the page.
const pageFlights = (data, places, bands, numbers) => {
  const { rows } = data;
  const columns = new Map(data.columns.map((entry) => [entry.name, entry]));
  const column = (name) => numbers(`column:${name}`);
  const everyone = data.order; // row numbers, worst flight first

  const ended = (row) => { // This text is the same as that of `ended_words` in Python.
    const missed = rows.missed.filter((flags) => flags[row]).length;
    if (rows.failed[row]) return data.outcomes[rows.outcome[row]];
    return missed ? `completed; misses ${missed} of ${rows.missed.length}` : "completed";
  };
  const members = ({ controllers, outcome, brushes }) => {
    const shown = data.controllers.map((each) => controllers.includes(each.name));
    const flags = outcome === "all" ? null : outcome === "failed" || outcome === "ok" ? rows.failed : rows.missed[Number(outcome.split(" ")[1])];
    const wanted = outcome === "ok" ? 0 : 1;
    const inside = Object.entries(brushes).map(([name, [low, high]]) => [column(name), low, high]);
    return everyone.filter((row) => shown[rows.controller[row]] && (!flags || flags[row] === wanted) &&
      inside.every(([values, low, high]) => values[row] >= low && values[row] <= high));
  };
  const order = (found, { sort, down }) => {
    if (sort === "rank") return found;
    const words = { outcome: ended, controller: (row) => rows.controller[row], flight: (row) => rows.flight[row] };
    const key = words[sort] ?? ((row) => column(sort)[row]);
    const missing = (value) => typeof value === "number" && !Number.isFinite(value);
    return [...found].sort((a, b) => { // missing values come last in both directions; equal values stay sorted by severity
      const [one, other] = [key(a), key(b)];
      if (missing(one) || missing(other)) return missing(one) - missing(other);
      return (one < other ? -1 : one > other ? 1 : 0) * (down ? -1 : 1);
    });
  };
  const reach = (values, found) => {
    const held = found.map((row) => values[row]).filter(Number.isFinite);
    return held.length ? [held.reduce((a, b) => Math.min(a, b)), held.reduce((a, b) => Math.max(a, b))] : [0, 0];
  };
  const bars = (name, found) => {
    const [values, [low, high]] = [column(name), columns.get(name).ends];
    const counts = new Map();
    for (const row of found) {
      if (!Number.isFinite(values[row])) continue;
      const bar = Math.min(Math.floor(((values[row] - low) / (high - low || 1)) * data.bars), data.bars - 1);
      counts.set(bar, (counts.get(bar) ?? 0) + 1);
    }
    return [...counts];
  };

  const count = async (asked) => {
    const found = members(asked);
    const [xs, ys] = [column(asked.x), column(asked.y)];
    const drawn = found.filter((row) => Number.isFinite(xs[row]) && Number.isFinite(ys[row]));
    return { count: found.length, cells: [],
      ends: asked.fit ? [reach(xs, drawn), reach(ys, drawn)] : [columns.get(asked.x).ends, columns.get(asked.y).ends],
      points: drawn.map((row) => [rows.controller[row], xs[row], ys[row], rows.flight[row], rows.failed[row]]),
      strips: Object.fromEntries(data.strips.map((name) => [name, bars(name, found)])),
      rows: order(found, asked).slice(0, data.listed).map((row) => [rows.controller[row], rows.flight[row], ended(row),
        ...data.headed.map((name) => column(name)[row]), ...(data.histories ? [rows.history[row] >= 0 ? "kept" : ""] : [])]) };
  };
  const flight = async (k, number) => {
    const row = rows.flight.findIndex((each, i) => each === number && rows.controller[i] === k);
    if (row < 0) throw new Error("it is not on this page");
    const h = rows.history[row];
    return { controller: k, flight: number, outcome: ended(row), by: rows.by[row],
      missed: rows.missed.map((flags) => flags[row] === 1),
      values: Object.fromEntries(data.columns.map(({ name }) => [name, column(name)[row]])),
      note: h >= 0 || !data.drawn_again ? "" : `No history of this flight is stored; abhv-mc explore ${data.folder} computes any flight.`,
      history: h < 0 ? null : { time: numbers("history-time"),
        channels: Object.fromEntries(data.channels.map(({ name }) => [name, numbers(`history:${name}`, h)])) } };
  };
  const behind = async (k, channel) => {
    const { name } = data.controllers[k];
    if (!places[`${channel}:${name}`]) return null;
    return { time: numbers(`time:${name}`), ...Object.fromEntries(bands.map((band, i) => [band, numbers(`${channel}:${name}`, i)])) };
  };
  // Numbers are written with as many digits as the page stores, because each is a multiple of a small step.
  const csv = async (asked) => {
    const digits = new Map(data.columns.map(({ name }) => {
      const { low, high } = places[`column:${name}`];
      return [name, Math.min(12, Math.max(0, Math.ceil(-Math.log10((high - low) / 65534 || 1e-9))))];
    }));
    const quoted = (words) => (/[",\n]/.test(words) ? `"${words.replaceAll('"', '""')}"` : words);
    const head = ["controller", "flight", "outcome", ...data.columns.map((entry) => entry.head)];
    const lines = order(members(asked), asked).map((row) => [data.controllers[rows.controller[row]].name, String(rows.flight[row]),
      data.outcomes[rows.outcome[row]], ...data.columns.map(({ name }) => {
        const value = column(name)[row];
        return Number.isFinite(value) ? String(Number(value.toFixed(digits.get(name)))) : "";
      })]);
    return URL.createObjectURL(new Blob([[head, ...lines].map((line) => `${line.map(quoted).join(",")}\n`).join("")], { type: "text/csv" }));
  };
  const nearest = async () => null; // not needed, because every flight is drawn as a point
  return { view: data, count, flight, behind, nearest, csv };
};
