(() => {
  "use strict";
  const find = (id) => document.getElementById(id);
  const still = matchMedia("(prefers-reduced-motion: reduce)");
  const read = (id) => JSON.parse(find(id).textContent);

  // The theme: what the system says, until the reader chooses.
  const theme = find("theme");
  const dark = () => (document.documentElement.dataset.theme || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light")) === "dark";
  const named = () => { theme.textContent = dark() ? "Light" : "Dark"; theme.setAttribute("aria-label", `Switch to the ${dark() ? "light" : "dark"} theme`); };
  theme.hidden = false;
  named();
  theme.addEventListener("click", () => { document.documentElement.dataset.theme = dark() ? "light" : "dark"; named(); });

  // A link into a folded section opens it.
  const unfold = () => { for (let at = location.hash.length > 1 && find(location.hash.slice(1)); at; at = at.parentElement) { if (at.tagName === "SECTION") { const fold = at.querySelector("details"); if (fold) fold.open = true; } if (at.tagName === "DETAILS") at.open = true; } };
  addEventListener("hashchange", unfold);
  unfold();

  for (const button of document.querySelectorAll("button[data-copy]")) {
    button.hidden = false;
    button.addEventListener("click", async () => {
      const text = find(button.dataset.copy);
      try {
        await navigator.clipboard.writeText(text.textContent);
        button.textContent = "Copied";
      } catch {
        getSelection().selectAllChildren(text);
        button.textContent = "Selected: copy it";
      }
    });
  }

  // Marks: one tab stop per figure, arrows go on within it.
  for (const drawing of document.querySelectorAll("svg")) {
    const marks = [...drawing.querySelectorAll("[data-mark]")];
    marks.forEach((mark, k) => {
      mark.setAttribute("tabindex", k ? "-1" : "0");
      mark.addEventListener("keydown", (event) => {
        const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
        const next = step && marks[k + step];
        if (!next) return;
        event.preventDefault();
        mark.setAttribute("tabindex", "-1");
        next.setAttribute("tabindex", "0");
        next.focus();
      });
    });
  }

  const picture = find("pose-picture");
  if (!picture) return;
  const poses = read("poses");
  const looks = read("looks");
  const summary = find("pose-summary");
  const play = find("pose-play");
  const layer = (name) => find(`pose-${name}`);
  const add = (parent, tag, attributes) => {
    const made = document.createElementNS(picture.namespaceURI, tag);
    for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
    return parent.appendChild(made);
  };
  const placed = ([x, y, degrees, along]) => `translate(${x} ${y}) rotate(${degrees})${along === undefined ? "" : ` scale(${along} 1)`}`;
  // A mechanism of space is turned by the pointer, or by arrow keys, about the middle of the picture.
  let yaw = 0;
  let pitch = 0;
  const seen = (x, y, z) => {
    const [c, s, C, S] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
    const fit = poses.scenes[shown.scene].fit;
    const near = fit + (1 - fit) * Math.abs(c * C);
    const [right, down] = [x - poses.width / 2, y - poses.height / 2];
    return [poses.width / 2 + near * (right * c + z * s), poses.height / 2 + near * (down * C + (z * c - right * s) * S)];
  };
  const turned = (place) => {
    const [x, y, degrees, along, near, far] = place;
    if (near === undefined || (yaw === 0 && pitch === 0)) return place.slice(0, 4);
    const one = seen(x, y, near);
    if (far === undefined) return [...one, 0, 1];
    const angle = (degrees * Math.PI) / 180;
    const [right, down] = seen(x + 100 * along * Math.cos(angle), y + 100 * along * Math.sin(angle), far).map((v, k) => v - one[k]);
    return [...one, (Math.atan2(down, right) * 180) / Math.PI, Math.hypot(right, down) / 100];
  };
  const guide = (parent, path) => { if (path) add(parent, "path", { d: path, fill: "none", "stroke-width": 1, "stroke-opacity": 0.45 }); };
  const build = (parent, parts, places) => {
    parent.replaceChildren();
    parts.slice(0, places.length).forEach((part, k) => {
      const group = add(parent, "g", { transform: placed(turned(places[k])) });
      add(group, "path", { d: part.path, "fill-opacity": "0.08", "stroke-linejoin": "round", "stroke-linecap": "round" });
      guide(group, part.guide);
      for (const [cx, cy] of part.pins) add(group, "circle", { cx, cy, r: 2.6 });
    });
  };
  let shown = poses.marks[poses.first];
  let timer = 0;
  const stop = () => { clearInterval(timer); timer = 0; play.textContent = "Play the cycle"; play.setAttribute("aria-pressed", "false"); };
  const grounded = (scene) => {
    layer("ground").replaceChildren();
    for (const [left, top, near] of scene.ground) {
      const [x, y] = near === undefined || (yaw === 0 && pitch === 0) ? [left, top] : seen(left, top, near);
      add(layer("ground"), "path", { d: `M${x - 7} ${y + 9}L${x} ${y}L${x + 7} ${y + 9}z` });
    }
    guide(layer("ground"), scene.guide);
  };
  const spatial = () => poses.scenes[shown.scene].fit !== undefined;
  const move = (parent, places) => [...parent.children].forEach((part, k) => part.setAttribute("transform", placed(turned(places[k]))));
  const turn = (right, down) => {
    if (!spatial()) return;
    yaw += right;
    pitch = Math.max(-Math.PI / 2, Math.min(Math.PI / 2, pitch + down));
    grounded(poses.scenes[shown.scene]);
    if (timer) return; // the next frame is on its way
    move(layer("truth"), shown.pose);
    move(layer("ghost"), shown.ghost);
  };
  const turnable = () => {
    picture.toggleAttribute("data-turns", spatial());
    if (spatial()) picture.setAttribute("tabindex", "0"); else picture.removeAttribute("tabindex");
  };
  const show = (number) => {
    if (shown !== poses.marks[number]) yaw = pitch = 0;
    shown = poses.marks[number];
    const scene = poses.scenes[shown.scene];
    const colour = looks[shown.look];
    grounded(scene);
    build(layer("truth"), scene.parts, shown.pose);
    layer("ghost").setAttribute("stroke", colour);
    build(layer("ghost"), scene.parts, shown.ghost);
    layer("arrows").replaceChildren();
    for (const [x, y, a, b, c, d] of shown.arrows) {
      add(layer("arrows"), "path", { d: `M${x} ${y}L${a} ${b}`, stroke: "currentColor" });
      add(layer("arrows"), "path", { d: `M${x} ${y}L${c} ${d}`, stroke: colour, "stroke-dasharray": "4 3" });
    }
    find("pose-name").textContent = shown.summary;
    summary.textContent = shown.summary;
    turnable();
    find("pose-scene").textContent = `${scene.name} (record ${scene.key})`;
    layer("ghost").removeAttribute("opacity");
  };
  const point = (mark) => {
    for (const before of document.querySelectorAll("[data-shown]")) before.removeAttribute("data-shown");
    mark.setAttribute("data-shown", "");
    stop();
    show(Number(mark.dataset.pose));
  };
  for (const mark of document.querySelectorAll("[data-pose]")) {
    for (const kind of ["focus", "mouseenter", "click"]) mark.addEventListener(kind, () => point(mark));
  }
  picture.addEventListener("pointerdown", (event) => { if (spatial()) picture.setPointerCapture(event.pointerId); });
  picture.addEventListener("pointermove", (event) => {
    if (picture.hasPointerCapture(event.pointerId)) turn(event.movementX / 100, event.movementY / 100);
  });
  picture.addEventListener("keydown", (event) => {
    const [right, down] = { ArrowRight: [0.1, 0], ArrowLeft: [-0.1, 0], ArrowDown: [0, 0.1], ArrowUp: [0, -0.1] }[event.key] || [];
    if (right === undefined || !spatial()) return;
    event.preventDefault();
    turn(right, down);
  });
  turnable();
  find("pose-controls").hidden = false;
  play.addEventListener("click", () => {
    if (timer) { stop(); show(poses.marks.indexOf(shown)); return; }
    const scene = poses.scenes[shown.scene];
    const ghosts = shown.cycle ? shown.cycle.frames : [];
    let frame = 0;
    build(layer("ghost"), scene.parts, ghosts.find(Boolean) || []);
    layer("arrows").replaceChildren();
    summary.textContent = shown.moving;
    play.textContent = "Stop";
    play.setAttribute("aria-pressed", "true");
    timer = setInterval(() => {
      frame = (frame + 1) % scene.frames.length;
      move(layer("truth"), scene.frames[frame]);
      layer("ghost").setAttribute("opacity", ghosts[frame] ? "1" : "0");
      if (ghosts[frame]) move(layer("ghost"), ghosts[frame]);
    }, still.matches ? 700 : 110);
  });
})();
