"use strict";
// Curves become plots whose values can be read off; without this script the drawings below stay.
(() => {
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const dashes = { 2: [7, 3], 3: [2.5, 2], 4: [9, 3, 2, 3], 6: [5, 3] };
  const faded = (name, share) => {
    const [r, g, b] = css(name).match(/\w\w/g).map((part) => parseInt(part, 16));
    return `rgba(${r},${g},${b},${share})`;
  };
  const plots = new Map();

  const nearest = (values, wanted) => {
    let low = 0, high = values.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (values[middle] <= wanted) low = middle; else high = middle;
    }
    return wanted - values[low] <= values[high] - wanted ? low : high;
  };
  const text = (value) => (value === null ? "–" : String(value).replace("-", "−"));

  function read(plot, panel, out) {
    const { left } = plot.cursor;
    if (left == null || left < 0) { out.textContent = panel.x_label; return; }
    const time = plot.posToVal(left, "x");
    const near = panel.curves.filter((curve, place) => curve.x.length && plot.series[place + 1].show);
    const values = near.map((curve) => `${curve.name} ${text(curve.y[nearest(curve.x, time)])}`);
    out.textContent = `${panel.x_label.replace(/ \(.*/, "")} ${text(Number(time.toFixed(3)))}: ${values.join("; ")}`;
  }

  function options(panel, box, out, figure) {
    const axis = { stroke: () => css("--soft"), grid: { stroke: () => css("--line"), width: 1 }, ticks: { show: false } };
    axis.font = `12px ${css("--sans")}`;
    const curves = panel.curves.map((curve) => ({
      label: curve.name, scale: "y", points: { show: false }, stroke: () => (curve.pale ? faded(`--look${curve.look}`, .45) : css(`--look${curve.look}`)),
      width: curve.pale || !curve.look ? 4 : 1.4, dash: curve.pale ? undefined : dashes[curve.look],
      paths: curve.held ? uPlot.paths.stepped({ align: 1 }) : undefined,
    }));
    const edges = panel.bands.flatMap((band) => [0, 1].map(() => ({ label: band.name, scale: "y", points: { show: false }, stroke: () => faded(`--look${band.look}`, .3), width: 0.5 })));
    const first = 1 + curves.length;
    return {
      width: box.clientWidth, height: Math.round(box.clientWidth / 2), legend: { show: false },
      padding: [8, 8, 0, 0],
      cursor: { sync: { key: `${figure}${panel.x}` }, drag: { x: true, y: false, uni: 20 }, points: { show: false }, y: false },
      scales: { x: { time: false, range: (plot, low, high) => [low, high] }, y: { range: () => panel.y } },
      axes: [{ ...axis, label: undefined, size: 34 }, { ...axis, size: 54 }],
      series: [{}, ...curves, ...edges],
      bands: panel.bands.map((band, place) => ({ series: [first + 2 * place + 1, first + 2 * place], fill: () => faded(`--look${band.look}`, .1) })),
      hooks: {
        setCursor: [(plot) => read(plot, panel, out)],
        setScale: [(plot, key) => { if (key === "x") follow(plot, panel, figure); }],
      },
    };
  }

  let following = false;
  function follow(source, panel, figure) {
    if (following) return;
    following = true;
    const { min, max } = source.scales.x;
    for (const [plot, held] of plots)
      if (plot !== source && held.figure === figure && String(held.panel.x) === String(panel.x)) plot.setScale("x", { min, max });
    following = false;
  }

  function data(panel) {
    const pieces = panel.curves.map((curve) => [curve.x, curve.y]);
    for (const band of panel.bands) pieces.push([band.x, band.low], [band.x, band.high]);
    return uPlot.join(pieces);
  }

  function keys(event, plot, panel) {
    const [first, last] = panel.x;
    const { min, max } = plot.scales.x, span = max - min;
    const left = plot.cursor.left >= 0 ? plot.cursor.left : plot.over.clientWidth / 2;
    const at = plot.posToVal(left, "x");
    const look = (low, high) => plot.setScale("x", { min: Math.max(low, first), max: Math.min(high, last) });
    const point = (time) => {
      const inside = Math.min(Math.max(time, plot.scales.x.min), plot.scales.x.max);
      plot.setCursor({ left: plot.valToPos(inside, "x"), top: plot.over.clientHeight / 2 }, true, true);
    };
    const step = span / 100;
    const done = {
      ArrowLeft: () => (event.shiftKey ? look(min - span / 4, max - span / 4) : point(at - step)),
      ArrowRight: () => (event.shiftKey ? look(min + span / 4, max + span / 4) : point(at + step)),
      Home: () => point(min), End: () => point(max),
      "+": () => look(at - span / 4, at + span / 4), "=": () => look(at - span / 4, at + span / 4),
      "-": () => look(at - span, at + span), Escape: () => look(first, last),
    }[event.key];
    if (!done || event.ctrlKey || event.metaKey || event.altKey) return;
    done();
    event.preventDefault();
  }

  function build(box) {
    const figure = box.closest(".plate");
    const panel = JSON.parse(figure.querySelector(".data").textContent)[box.dataset.panel];
    const place = document.createElement("div"), out = document.createElement("output");
    place.className = "plot"; out.className = "readout";
    box.append(place, out);
    box.classList.add("drawn");
    out.textContent = panel.x_label;
    const plot = new uPlot(options(panel, box, out, figure.id), data(panel), place);
    plots.set(plot, { panel, figure: figure.id, box });
    plot.setScale("x", { min: panel.x[0], max: panel.x[1] });
    box.tabIndex = 0;
    box.setAttribute("role", "group");
    box.setAttribute("aria-label", `${box.querySelector("svg").getAttribute("aria-label")}. Arrow keys read values, plus and minus zoom, Escape shows all.`);
    box.addEventListener("keydown", (event) => keys(event, plot, panel));
    plot.over.addEventListener("dblclick", () => plot.setScale("x", { min: panel.x[0], max: panel.x[1] }));
    for (const button of figure.querySelectorAll("[aria-pressed=false]")) show(figure, button.parentElement.dataset.name, false);
  }

  function show(figure, name, on) {
    for (const path of figure.querySelectorAll("svg.static [data-name]")) if (path.dataset.name === name) path.classList.toggle("off", !on);
    for (const [plot, held] of plots)
      if (held.figure === figure.id) plot.series.forEach((series, place) => { if (place && series.label === name) plot.setSeries(place, { show: on }); });
  }

  for (const entry of document.querySelectorAll(".legend li")) {
    const button = document.createElement("button");
    button.type = "button";
    button.setAttribute("aria-pressed", "true");
    button.append(...entry.childNodes);
    entry.append(button);
    button.addEventListener("click", () => {
      const on = button.getAttribute("aria-pressed") === "false";
      button.setAttribute("aria-pressed", String(on));
      show(entry.closest(".plate"), entry.dataset.name, on);
    });
  }

  const watch = new IntersectionObserver((entries) => {
    for (const { isIntersecting, target } of entries) if (isIntersecting) { watch.unobserve(target); build(target); }
  }, { rootMargin: "300px" });
  for (const box of document.querySelectorAll(".panel.live")) watch.observe(box);
  addEventListener("resize", () => { for (const [plot, { box }] of plots) plot.setSize({ width: box.clientWidth, height: Math.round(box.clientWidth / 2) }); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { for (const plot of plots.keys()) plot.redraw(false, true); });

  // A link into evidence that is closed opens it.
  const open = () => { const found = document.getElementById(decodeURIComponent(location.hash.slice(1))); for (let up = found; up; up = up.parentElement) if (up.tagName === "DETAILS") up.open = true; };
  addEventListener("hashchange", open);
  open();
})();
