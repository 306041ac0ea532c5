"use strict";
(() => {
  const root = document.documentElement, byId = (id) => document.getElementById(id);
  root.classList.add("scripted");
  document.querySelectorAll(".tools, .filter, #copy").forEach((element) => { element.hidden = false; });

  // --- colours, printing, copying, filtering ---------------------------------------------------------------
  const themes = ["auto", "dark", "light"], names = { auto: "Auto", dark: "Dark", light: "Light" };
  let theme = 0;
  byId("theme").addEventListener("click", () => {
    theme = (theme + 1) % themes.length;
    const name = themes[theme];
    if (name === "auto") delete root.dataset.theme; else root.dataset.theme = name;
    byId("theme").textContent = names[name];
    byId("theme").setAttribute("aria-label", `Colours: ${name === "auto" ? "as the system" : name}`);
    draw();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => draw());
  byId("print").addEventListener("click", () => window.print());
  byId("copy")?.addEventListener("click", async () => {
    const button = byId("copy"), range = document.createRange();
    range.selectNodeContents(byId("command"));
    getSelection().removeAllRanges();
    getSelection().addRange(range);
    try { await navigator.clipboard.writeText(byId("command").textContent); } catch { document.execCommand("copy"); }
    button.textContent = "Copied";
    setTimeout(() => { button.textContent = "Copy"; }, 1500);
  });
  byId("candidate-table")?.classList.add("fitted-only");
  byId("all-candidates")?.addEventListener("change", (event) => {
    byId("candidate-table").classList.toggle("fitted-only", !event.target.checked);
  });

  const links = new Map([...document.querySelectorAll(".contents a")].map((a) => [a.hash.slice(1), a]));
  const seen = new IntersectionObserver((entries) => {
    for (const entry of entries) if (entry.isIntersecting) {
      links.forEach((a) => a.removeAttribute("aria-current"));
      links.get(entry.target.id)?.setAttribute("aria-current", "true");
    }
  }, { rootMargin: "-15% 0px -75% 0px" });
  links.forEach((_, id) => { if (byId(id)) seen.observe(byId(id)); });

  // --- the viewer: measured, model and residuals over one axis of time -------------------------------------
  const runs = JSON.parse(byId("data").textContent).runs, viewer = byId("viewer");
  if (!viewer || !runs.length) { window.reportReady = performance.now(); return; }
  viewer.hidden = false;
  const tabs = [...viewer.querySelectorAll("[role=tab]")], hidden = new Set();
  let shown = 0, plots = [], whole = [0, 1], view = null;

  const unpack = (text, Kind) => {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    return new Kind(bytes.buffer);
  };
  // uPlot breaks a line at null; typed arrays hold NaN instead
  const gaps = (values) => values.some(Number.isNaN) ? Array.from(values, (x) => (Number.isNaN(x) ? null : x)) : values;
  const decoded = new Map();
  const decode = (k) => {
    if (decoded.has(k)) return decoded.get(k);
    const run = runs[k], floats = (text) => gaps(unpack(text, Float32Array));
    const found = {
      time: unpack(run.time, Float64Array),
      outputs: run.outputs.map((output) => ({
        ...output,
        measured: floats(output.measured),
        sd: output.sd && unpack(output.sd, Float32Array),
        curves: output.curves.map((c) => ({ label: c.label, values: floats(c.values), residual: floats(c.residual) })),
      })),
    };
    decoded.set(k, found);
    return found;
  };

  const color = (name) => getComputedStyle(root).getPropertyValue(`--${name}`).trim();
  const lookOf = (output, i) => (output.curves.length > 1 && i === 0 ? "before" : "after");
  const digits = (x) => (x === null || x === undefined || Number.isNaN(x) ? "–" : Number(x.toPrecision(4)).toString());
  const clamp = (low, high) => {
    const span = Math.min(high - low, whole[1] - whole[0]), least = (whole[1] - whole[0]) * 1e-5;
    const width = Math.max(span, least), begin = Math.min(Math.max(low, whole[0]), whole[1] - width);
    return [begin, begin + width];
  };

  const look = (low, high) => {
    view = clamp(low, high);
    plots.forEach((plot) => plot.setScale("x", { min: view[0], max: view[1] }));
    byId("charts").dataset.from = view[0];
    byId("charts").dataset.to = view[1];
  };
  const acts = {
    left: () => look(view[0] - 0.25 * (view[1] - view[0]), view[1] - 0.25 * (view[1] - view[0])),
    right: () => look(view[0] + 0.25 * (view[1] - view[0]), view[1] + 0.25 * (view[1] - view[0])),
    in: () => look(view[0] + 0.25 * (view[1] - view[0]), view[1] - 0.25 * (view[1] - view[0])),
    out: () => look(view[0] - 0.5 * (view[1] - view[0]), view[1] + 0.5 * (view[1] - view[0])),
    all: () => look(...whole),
  };

  const band = (half, name) => (u) => {
    if (!half) return;
    const { ctx, bbox } = u, top = u.valToPos(half, "y", true), bottom = u.valToPos(-half, "y", true);
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.fillStyle = color(name);
    ctx.fillRect(bbox.left, top, bbox.width, bottom - top);
    ctx.restore();
  };

  const axis = (extra) => ({
    stroke: color("muted"), grid: { stroke: color("rule"), width: 1 }, ticks: { stroke: color("rule"), width: 1, size: 4 },
    font: `11px ${color("sans") || "sans-serif"}`, ...extra,
  });

  const title = (text, value) => {
    const p = document.createElement("p"), name = document.createElement("b"), out = document.createElement("span");
    p.className = "chart-title";
    name.textContent = text;
    out.className = "value";
    p.append(name, out);
    p.show = (t) => { out.textContent = t ?? value; };
    p.show();
    return p;
  };

  const chart = (holder, time, series, height, options) => {
    const data = [time, ...series.map((s) => s.values)];
    const plot = new uPlot({
      width: holder.clientWidth, height, pxAlign: 0, padding: [10, 14, 0, 0],
      legend: { show: false },
      cursor: { sync: { key: "run", setSeries: false }, drag: { x: true, y: false, uni: 10, setScale: false }, points: { size: 7 }, y: false },
      scales: { x: { time: false, range: () => view }, y: { range: (u, low, high) => {
        if (low === null) return [-1, 1];
        const reach = options.band ? 1.25 * options.band : 0;
        const a = Math.min(low, -reach || low), b = Math.max(high, reach || high), pad = 0.06 * (b - a || Math.abs(a) || 1);
        return [a - pad, b + pad];
      } } },
      axes: [
        axis({ size: options.last ? 30 : 4, space: 70, values: (u, ticks) => ticks.map((t, i) => (!options.last ? "" : i === ticks.length - 1 ? `${digits(t)} s` : digits(t))) }),
        axis({ size: 62, space: height > 150 ? 34 : 20, values: (u, ticks) => ticks.map(digits) }),
      ],
      series: [{}, ...series.map((s) => ({
        label: s.label, stroke: color(s.color), width: s.width, dash: s.dash, show: !hidden.has(s.look), points: { show: s.points },
        spanGaps: false,
      }))],
      bands: series.flatMap((s, i) => (s.upperOf ? [{ series: [i + 1, i], fill: color("band") }] : [])),
      hooks: {
        drawClear: [band(options.band, "band")],
        setCursor: [(u) => {
          const k = u.cursor.idx;
          const values = k === null || k === undefined ? [] : series.filter((s) => s.label).map((s) => `${s.label} ${digits(s.values[k])}`);
          options.title.show(values.length ? `${values.join("   ")} ${options.unit}` : undefined);
          if (options.first) byId("readout").textContent = values.length ? `At ${digits(time[k])} s.` : "";
        }],
        setSelect: [(u) => {
          if (u.select.width > 6) look(u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x"));
          u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
        }],
      },
    }, data, holder);
    plot.looks = series.map((s) => s.look);
    plot.over.addEventListener("dblclick", () => acts.all());
    // the wheel scrolls the page; with Ctrl it changes the scale, sideways or with Shift it moves along
    plot.over.addEventListener("wheel", (event) => {
      const span = view[1] - view[0], side = event.shiftKey ? event.deltaX || event.deltaY : event.deltaX;
      if (event.ctrlKey || event.metaKey) {
        const at = plot.posToVal(event.clientX - plot.over.getBoundingClientRect().left, "x");
        const scale = Math.exp(0.002 * Math.max(-200, Math.min(200, event.deltaY)));
        look(at - (at - view[0]) * scale, at + (view[1] - at) * scale);
      } else if (Math.abs(side) > Math.abs(event.shiftKey ? 0 : event.deltaY)) {
        look(view[0] + (side / plot.over.clientWidth) * span, view[1] + (side / plot.over.clientWidth) * span);
      } else return;
      event.preventDefault();
    }, { passive: false });
    touch(plot);
    return plot;
  };

  // one finger moves along a run that is looked at closely, two change the scale
  const touch = (plot) => {
    let begin = null;
    const along = (event) => [...event.touches].map((t) => plot.posToVal(t.clientX - plot.over.getBoundingClientRect().left, "x"));
    plot.over.addEventListener("touchstart", (event) => {
      const at = along(event);
      begin = { view: [...view], x: [...event.touches].map((t) => t.clientX), at };
    }, { passive: true });
    plot.over.addEventListener("touchmove", (event) => {
      if (!begin || begin.x.length !== event.touches.length) return;
      const width = plot.over.clientWidth, x = [...event.touches].map((t) => t.clientX), span = begin.view[1] - begin.view[0];
      if (x.length === 2) {
        const scale = Math.abs(begin.x[0] - begin.x[1]) / Math.max(8, Math.abs(x[0] - x[1])), middle = (begin.at[0] + begin.at[1]) / 2;
        event.preventDefault();
        look(middle - (middle - begin.view[0]) * scale, middle + (begin.view[1] - middle) * scale);
      } else if (span < 0.999 * (whole[1] - whole[0]) && Math.abs(x[0] - begin.x[0]) > 6) {
        const shift = ((begin.x[0] - x[0]) / width) * span;
        event.preventDefault();
        look(begin.view[0] + shift, begin.view[1] + shift);
      }
    }, { passive: false });
  };

  const toggles = (output) => {
    const bar = byId("toggles");
    bar.replaceChildren();
    for (const [look, label] of [["measured", "measured"], ...output.curves.map((c, i) => [lookOf(output, i), c.label])]) {
      const box = document.createElement("input"), key = document.createElement("i"), text = document.createElement("label");
      box.type = "checkbox";
      box.checked = !hidden.has(look);
      key.className = look;
      key.setAttribute("aria-hidden", "true");
      text.append(box, key, label);
      box.addEventListener("change", () => {
        if (box.checked) hidden.delete(look); else hidden.add(look);
        plots.forEach((plot) => plot.looks.forEach((l, i) => { if (l === look) plot.setSeries(i + 1, { show: box.checked }); }));
      });
      bar.append(text);
    }
  };

  const draw = () => {
    const { time, outputs } = decode(shown), holder = byId("charts"), n = time.length, many = n > 400;
    plots.forEach((plot) => plot.destroy());
    plots = [];
    holder.replaceChildren();
    whole = [time[0], time[n - 1]];
    view = view ? clamp(...view) : whole;
    toggles(outputs[0]);
    for (const output of outputs) {
      const last = output.curves.length - 1, noise = output.noise;
      const head = title(`${output.name} [${output.unit}]`, "");
      holder.append(head);
      const models = output.curves.map((c, i) => {
        const look = lookOf(output, i);
        return { label: c.label.replace("model ", ""), values: c.values, color: `${look}-line`, look, width: 1.5, dash: look === "before" ? [7, 4] : undefined, points: false };
      });
      const sure = output.sd ? [-1, 1].map((sign) => ({
        values: gaps(Float32Array.from(output.sd, (sd, k) => output.curves[last].values[k] + sign * 1.96 * sd)),
        color: "band", look: "after", width: 0, points: false, upperOf: sign === 1,
      })) : [];
      const measured = { label: "measured", values: output.measured, color: "measured", look: "measured", width: many ? 4 : 0, points: !many };
      plots.push(chart(holder, time, [...sure, measured, ...models], 260, { title: head, unit: output.unit, first: output === outputs[0], last: false }));
      models.forEach((model, i) => {
        const residual = output.curves[i].residual, strip = title(`residual${models.length > 1 ? ` ${model.label}` : ""} [${output.unit}]`, noise ? `noise ${digits(Number(noise.toPrecision(3)))} ${output.unit}` : "");
        holder.append(strip);
        plots.push(chart(holder, time, [{ ...model, label: "residual", values: residual, dash: undefined, width: 1 }], i === last ? 118 : 92, {
          title: strip, unit: output.unit, band: noise ? 2 * noise : 0, last: i === last,
        }));
      });
    }
    look(...view);
    byId("charts").setAttribute("aria-label", `${runs[shown].name}: ${outputs.map((o) => o.name).join(", ")}`);
  };

  const select = (k) => {
    shown = (k + tabs.length) % tabs.length;
    tabs.forEach((tab, i) => {
      tab.setAttribute("aria-selected", String(i === shown));
      tab.tabIndex = i === shown ? 0 : -1;
    });
    byId("panel").setAttribute("aria-labelledby", `tab-${shown}`);
    view = null;
    draw();
  };
  tabs.forEach((tab, i) => {
    tab.addEventListener("click", () => select(i));
    tab.addEventListener("keydown", (event) => {
      const to = { ArrowRight: shown + 1, ArrowLeft: shown - 1, Home: 0, End: tabs.length - 1 }[event.key];
      if (to === undefined) return;
      event.preventDefault();
      select(to);
      tabs[shown].focus();
    });
  });
  viewer.querySelectorAll("[data-view]").forEach((button) => button.addEventListener("click", () => acts[button.dataset.view]()));
  byId("panel").addEventListener("keydown", (event) => {
    if (event.target.tagName === "INPUT" || event.ctrlKey || event.metaKey || event.altKey) return;
    const act = { ArrowLeft: "left", ArrowRight: "right", "+": "in", "=": "in", "-": "out", "0": "all" }[event.key];
    if (act) { event.preventDefault(); acts[act](); }
  });
  let width = 0;
  new ResizeObserver(([entry]) => {
    if (Math.abs(entry.contentRect.width - width) < 1) return;
    width = entry.contentRect.width;
    plots.forEach((plot) => plot.setSize({ width, height: plot.height }));
  }).observe(byId("charts"));

  const first = Math.max(0, runs.findIndex((_, k) => tabs[k].querySelector(".role").textContent === "test"));
  select(first);
  window.reportReady = performance.now();
})();
