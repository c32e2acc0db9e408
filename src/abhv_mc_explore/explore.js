// View of flights whose counts are supplied by a server.
(async () => {
  const token = encodeURIComponent(document.body.dataset.token);
  const ask = async (place, data) => {
    const options = data === undefined ? {} : { method: "POST", body: JSON.stringify(data) };
    const reply = await fetch(`${place}?token=${token}`, options);
    const found = await reply.json();
    if (!reply.ok) throw new Error(found.error);
    return found;
  };
  const view = await ask("view");
  document.getElementById("name").textContent = view.name;
  document.getElementById("folder").textContent = view.folder;
  const counted = new Map(); // cache of the counts without brushes, which never change
  const count = (asked) => {
    if (Object.keys(asked.brushes).length || asked.fit) return ask("counts", asked);
    const key = JSON.stringify(asked);
    if (!counted.has(key)) counted.set(key, ask("counts", asked));
    return counted.get(key);
  };
  const source = { view, count,
    nearest: (asked, x, y) => ask("nearest", { ...asked, at: [x, y] }),
    flight: (k, flight) => ask("flight", { controller: view.controllers[k].name, flight }),
    behind: (k, channel) => ask("behind", { controller: view.controllers[k].name, channel }),
    csv: async (asked) => `csv?token=${token}&asked=${encodeURIComponent(JSON.stringify(asked))}` };
  const color = (name) => () => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const style = { font: "system-ui, Segoe UI, Liberation Sans, Arial, sans-serif", ink: color("--ink"), line: color("--line"), link: color("--link"), paper: color("--paper") };
  const shown = await flightsView(source, style);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", shown.draw);
})();
