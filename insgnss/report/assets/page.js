"use strict";
(() => {
  const charts = JSON.parse(document.getElementById("charts").textContent);
  const places = new Map(charts.map((chart) => [chart.name, chart]));
  const linked = charts.filter((chart) => chart.linked);
  const drawn = new Set();
  const numbers = (x) => (Array.isArray(x) ? x
    : new Float64Array(Uint8Array.from(atob(x.bdata), (letter) => letter.charCodeAt(0)).buffer));
  const whole = wholeSpan(); // of every time axis as the page opens
  let span = whole; // of the time axes now, in seconds whatever they show

  // UTC of time 0, where the page knows it: the axes then show dates instead of seconds
  const button = document.getElementById("utc");
  const originMs = button ? Number(button.dataset.originMs) : 0;
  let utc = false;
  const onAxis = (t) => {
    if (!utc) return t;
    return Number.isFinite(t) ? new Date(originMs + 1000 * t).toISOString().slice(0, -1).replace("T", " ") : null;
  };
  const seconds = (value) => {
    if (typeof value === "number") return value;
    const [day, time] = value.split(" ");
    return (Date.parse(day + "T" + (time || "00:00") + "Z") - originMs) / 1000;
  };

  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const axisNames = (layout) => Object.keys(layout).filter((key) => /^[xy]axis\d*$/.test(key));

  // one span for all: a chart of points would open wider than a chart of lines
  function wholeSpan() {
    let from = Infinity, to = -Infinity;
    for (const chart of linked) {
      for (const trace of chart.data) {
        for (const t of numbers(trace.x)) {
          if (t < from) from = t;
          if (t > to) to = t;
        }
      }
    }
    const edge = 0.004 * (to - from) || 0.5;
    return [from - edge, to + edge];
  }

  function themed(layout) {
    const ink = css("--ink"), grid = css("--grid"), paper = css("--paper");
    const look = {
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      "font.color": ink, "legend.bgcolor": "rgba(0,0,0,0)",
      "hoverlabel.bgcolor": paper, "hoverlabel.font.color": ink, "hoverlabel.bordercolor": css("--rule"),
      "modebar.bgcolor": "rgba(0,0,0,0)", "modebar.color": css("--rule"), "modebar.activecolor": ink,
    };
    for (const key of axisNames(layout)) {
      look[key + ".gridcolor"] = grid;
      look[key + ".zerolinecolor"] = css("--rule");
      look[key + ".linecolor"] = css("--rule");
    }
    if (layout.polar) {
      look["polar.bgcolor"] = "rgba(0,0,0,0)";
      look["polar.radialaxis.gridcolor"] = grid;
      look["polar.angularaxis.gridcolor"] = grid;
      look["polar.angularaxis.linecolor"] = css("--rule");
    }
    return look;
  }

  function complete(layout) {
    const narrow = window.innerWidth < 600;
    const full = Object.assign({
      margin: { l: narrow ? 52 : 66, r: 12, t: 10, b: 44 }, autosize: true, hovermode: "closest",
      legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0, itemsizing: "constant" }, font: { size: narrow ? 11 : 12 },
      dragmode: narrow ? false : "zoom",
    }, layout);
    for (const key of axisNames(full)) {
      full[key] = Object.assign({ automargin: true, zeroline: false, ticks: "outside", exponentformat: "power" }, full[key]);
    }
    return dressed(full);
  }

  function dressed(full) {
    for (const [path, value] of Object.entries(themed(full))) {
      const keys = path.split("."), last = keys.pop();
      let at = full;
      for (const key of keys) at = at[key] = at[key] || {};
      at[last] = value;
    }
    return full;
  }

  function draw(place) {
    if (drawn.has(place.id)) return;
    drawn.add(place.id);
    const chart = places.get(place.id), layout = layoutOf(chart);
    if (layout.map) tellIfUnreachable(place);
    Plotly.newPlot(place, dataOf(chart), layout, {
      responsive: true, displaylogo: false, scrollZoom: Boolean(layout.map),
      displayModeBar: matchMedia("(hover: none)").matches ? false : "hover",
      modeBarButtonsToRemove: ["toImage", "select2d", "lasso2d", "autoScale2d"],
      modeBarButtonsToAdd: [{ name: "picture", title: "Save as a picture", icon: Plotly.Icons.camera, click: () => savePicture(place) }],
    });
    if (chart.linked) place.on("plotly_relayout", (change) => follow(place, change));
  }

  function layoutOf(chart) {
    const layout = complete(chart.layout);
    if (chart.linked) alignTime(layout);
    return layout;
  }

  function dataOf(chart) {
    if (!utc || !chart.linked) return chart.data;
    return chart.data.map((trace) => {
      const dated = Object.assign({}, trace, { x: Array.from(numbers(trace.x), onAxis) });
      if (trace.hovertemplate) dated.hovertemplate = trace.hovertemplate.replace("%{x:.2f} s", "%{x|%H:%M:%S.%2f}");
      return dated;
    });
  }

  // dark letters on white whatever the page is, and above the drawing what it is of
  function pictureOf(place) {
    const chart = places.get(place.id), width = Math.max(place.clientWidth, 700);
    const layout = JSON.parse(JSON.stringify(place.layout));
    const words = `<b>${chart.title}</b><br><sub>${document.body.dataset.about.replace(/</g, "&lt;")}</sub>`;
    Object.assign(layout, { paper_bgcolor: "#fff", plot_bgcolor: "#fff", width, height: place.clientHeight + 70, autosize: false });
    layout.font.color = "#1b1f24";
    layout.margin.t = Math.max(layout.margin.t || 0, 10) + 70;
    layout.title = { text: words, x: 0.01, xanchor: "left", y: 0.99, yanchor: "top", font: { size: 15, color: "#1b1f24" } };
    return { data: place.data, layout };
  }

  function savePicture(place) {
    const figure = pictureOf(place), { width, height } = figure.layout;
    const name = `${document.body.dataset.about} ${place.id.replace("chart-", "")}`.replace(/[^\p{L}\p{N}]+/gu, "_");
    return Plotly.downloadImage(figure, { format: "png", scale: 2, width, height, filename: name });
  }

  // the one thing that needs a network: without it the fold would be an empty frame
  async function tellIfUnreachable(place) {
    try {
      if (!navigator.onLine) throw new Error("offline");
      await fetch("https://tile.openstreetmap.org/0/0/0.png", { mode: "no-cors", signal: AbortSignal.timeout(8000) });
    } catch {
      const words = document.createElement("p");
      words.className = "unreachable";
      words.textContent = "The map's tiles cannot be fetched: there is no network, or openstreetmap.org does not answer."
        + " The track is drawn without them; the chart above needs no network.";
      place.before(words);
    }
  }

  // the same left edge below each other, so that a moment stands in one vertical line on the whole page
  function alignTime(layout) {
    layout.xaxis.range = span.map(onAxis);
    if (utc) Object.assign(layout.xaxis, { type: "date", title: { text: "time, UTC" }, tickformat: "", hoverformat: "%H:%M:%S.%2f" });
    if (utc && layout.shapes) layout.shapes = layout.shapes.map((line) => Object.assign({}, line, { x0: onAxis(line.x0), x1: onAxis(line.x1) }));
    layout.margin.l = window.innerWidth < 600 ? 62 : 78;
    for (const key of axisNames(layout)) if (key[0] === "y") layout[key].automargin = false;
  }

  function follow(source, change) {
    const all = change["xaxis.autorange"];
    if (!(all || "xaxis.range[0]" in change || "xaxis.range" in change)) return;
    const range = source.layout.xaxis.range;
    if (!all && range[0] === onAxis(span[0]) && range[1] === onAxis(span[1])) return; // it was moved from here
    span = all ? whole : range.map(seconds);
    const others = linked.map((chart) => document.getElementById(chart.name))
      .filter((place) => (all || place !== source) && drawn.has(place.id));
    for (const place of others) Plotly.relayout(place, { "xaxis.range": span.map(onAxis) });
  }

  if (button) button.addEventListener("click", () => {
    utc = !utc;
    button.setAttribute("aria-pressed", String(utc));
    for (const chart of linked.filter((one) => drawn.has(one.name))) {
      Plotly.react(document.getElementById(chart.name), dataOf(chart), layoutOf(chart));
    }
  });

  const all = [...document.querySelectorAll(".chart")];
  const watcher = new IntersectionObserver((entries) => {
    for (const entry of entries) {
      if (!entry.isIntersecting) continue;
      watcher.unobserve(entry.target);
      draw(entry.target);
    }
  }, { rootMargin: "600px" });
  all.forEach((place) => watcher.observe(place));

  function recolour() {
    for (const place of all) if (drawn.has(place.id)) Plotly.relayout(place, themed(places.get(place.id).layout));
  }
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recolour);
  // the media "print" has its own colours and width, and what was never seen has not been drawn
  addEventListener("beforeprint", () => {
    const printed = all.filter((place) => place.checkVisibility() || !place.closest("details"));
    printed.forEach(draw);
    for (const place of printed) {
      const width = place.closest("#sky") ? 340 : 680; // px: two beside each other, or the sheet's width
      Plotly.relayout(place, Object.assign(themed(places.get(place.id).layout), { width }));
    }
  });
  addEventListener("afterprint", () => {
    recolour();
    for (const place of all) if (drawn.has(place.id)) Plotly.relayout(place, { width: null, autosize: true });
  });

  const worth = (cell) => {
    const words = cell.textContent.trim(), value = Number.parseFloat(words);
    return Number.isNaN(value) ? words : value;
  };
  for (const table of document.querySelectorAll("table.sortable")) {
    const body = table.tBodies[0], heads = [...table.tHead.rows[0].cells];
    heads.forEach((head, column) => head.addEventListener("click", () => {
      const up = head.getAttribute("aria-sort") !== "ascending";
      heads.forEach((other) => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", up ? "ascending" : "descending");
      const rows = [...body.rows].map((row) => [worth(row.cells[column]), row]);
      rows.sort(([a], [b]) => (typeof a === typeof b ? (a < b ? -1 : a > b ? 1 : 0) : typeof a === "number" ? -1 : 1));
      if (!up) rows.reverse();
      body.append(...rows.map(([, row]) => row));
    }));
  }
  for (const input of document.querySelectorAll("input[data-table]")) {
    const name = input.dataset.table, rows = [...document.getElementById(name).tBodies[0].rows];
    const choice = document.querySelector(`select[data-table="${name}"]`);
    const told = document.querySelector(`output[data-table="${name}"]`);
    for (const kind of [...new Set(rows.map((row) => row.cells[1].textContent))].sort()) choice.add(new Option(kind, kind));
    const filter = () => {
      const word = input.value.toLowerCase();
      let shown = 0;
      for (const row of rows) {
        const fits = row.textContent.toLowerCase().includes(word)
          && (!choice.value || row.cells[1].textContent === choice.value);
        row.hidden = !fits;
        shown += fits;
      }
      told.textContent = `${shown} of ${rows.length}`;
    };
    input.addEventListener("input", filter);
    choice.addEventListener("change", filter);
    filter();
  }
})();
