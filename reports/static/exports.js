// What a reader takes along: figures as SVG and PNG, with title and legend, and tables as CSV and LaTeX, as they are shown.
"use strict";

const exporting = (() => {
  const FONT = '"Liberation Sans", Arial, Helvetica, sans-serif';
  const SVG = "http://www.w3.org/2000/svg";
  const PNG_SCALE = 2;
  const [TITLE, TEXT, GAP] = [13, 11, 6]; // sizes in points of the drawing

  const visible = (element) => element.getClientRects().length > 0;
  const headOf = (figure) => document.getElementById(figure.getAttribute("aria-labelledby")).textContent;

  function save(name, address) {
    const link = document.createElement("a");
    link.download = name;
    link.href = address;
    link.click();
  }

  const asAddress = (type, text) => `data:${type};charset=utf-8,${encodeURIComponent(text)}`;

  function button(words, name, press) {
    const made = document.createElement("button");
    made.type = "button";
    made.textContent = words;
    made.setAttribute("aria-label", `${words}: ${name}`);
    made.addEventListener("click", press);
    return made;
  }

  // Figures

  const canvas = document.createElement("canvas").getContext("2d");

  function widthOf(text, style) {
    canvas.font = `${style} ${FONT}`;
    return canvas.measureText(text).width;
  }

  // The lines into which words fall; a word that is too long by itself is broken.
  function folded(text, width, style) {
    const lines = [""];
    for (const piece of text.split(/(\s+)/)) {
      if (widthOf(lines.at(-1) + piece, style) <= width) lines[lines.length - 1] += piece;
      else if (widthOf(piece, style) <= width) lines.push(piece.trimStart());
      else {
        for (const sign of piece) {
          if (widthOf(lines.at(-1) + sign, style) <= width) lines[lines.length - 1] += sign;
          else lines.push(sign);
        }
      }
    }
    return lines.map((line) => line.trim()).filter(Boolean);
  }

  function node(name, attributes, ...content) {
    const made = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.append(...content);
    return made;
  }

  // The figure as it is shown, on white, in the colours of the light theme, with nothing that only the page knows.
  function picture(figure) {
    const drawings = [...figure.querySelectorAll(".drawing svg")].filter(visible);
    const boxes = drawings.map((drawing) => drawing.viewBox.baseVal);
    const width = Math.ceil(Math.max(...boxes.map((box) => box.width)));
    const parts = [];
    let y = GAP;

    for (const line of folded(headOf(figure), width - 2 * GAP, `bold ${TITLE}px`)) {
      y += TITLE;
      parts.push(node("text", { x: GAP, y, "font-size": TITLE, "font-weight": "bold" }, line));
      y += GAP / 2;
    }
    let x = GAP;
    y += GAP;
    for (const item of figure.querySelectorAll('.key li')) {
      if (item.querySelector('[aria-pressed="false"]')) continue;
      const swatch = item.querySelector(".swatch").cloneNode(true);
      const room = width - 40 - 2 * GAP;
      const lines = folded(item.textContent, room, `${TEXT}px`);
      const wide = 40 + Math.max(...lines.map((line) => widthOf(line, `${TEXT}px`)));
      if (x > GAP && x + wide > width - GAP) {
        x = GAP;
        y += TEXT + GAP;
      }
      swatch.setAttribute("x", x);
      swatch.setAttribute("y", y);
      parts.push(swatch);
      lines.forEach((line, i) => parts.push(node("text", { x: x + 38, y: y + 10 + i * (TEXT + 2), "font-size": TEXT }, line)));
      y += (lines.length - 1) * (TEXT + 2);
      x += wide + 2 * GAP;
    }
    y += x > GAP ? TEXT + 2 * GAP : 0;
    for (const [i, drawing] of drawings.entries()) {
      const copy = drawing.cloneNode(true);
      for (const hidden of copy.querySelectorAll(".off")) hidden.remove();
      for (const [key, value] of Object.entries({ x: 0, y, width: boxes[i].width, height: boxes[i].height })) copy.setAttribute(key, value);
      parts.push(copy);
      y += boxes[i].height;
    }
    y = Math.ceil(y);
    const whole = node("svg", { viewBox: `0 0 ${width} ${y}`, width, height: y, "font-family": FONT },
      node("desc", {}, figure.querySelector("figcaption").textContent),
      node("rect", { width: "100%", height: "100%", style: "fill: var(--paper)" }),
      node("g", { style: "fill: var(--ink)" }, ...parts));
    const light = document.createElement("div");
    light.className = "light";
    document.body.append(light);
    const colours = getComputedStyle(light);
    const text = new XMLSerializer().serializeToString(whole).replace(/var\((--[a-z0-9-]+)\)/g, (_, name) => colours.getPropertyValue(name).trim());
    light.remove();
    return { text, width, height: y };
  }

  function saveSvg(figure, name) {
    save(`${name}.svg`, asAddress("image/svg+xml", picture(figure).text));
  }

  // A data address, unlike one of the disk, leaves the canvas readable.
  async function savePng(figure, name) {
    const { text, width, height } = picture(figure);
    const image = new Image();
    image.src = asAddress("image/svg+xml", text);
    await image.decode();
    const sheet = document.createElement("canvas");
    sheet.width = Math.round(PNG_SCALE * width);
    sheet.height = Math.round(PNG_SCALE * height);
    sheet.getContext("2d").drawImage(image, 0, 0, sheet.width, sheet.height);
    save(`${name}.png`, sheet.toDataURL("image/png"));
  }

  // Tables

  // The rows as they are shown, each cell as its text; a cell over several columns is followed by empty ones.
  function rowsOf(table) {
    const shown = [...table.rows].filter(visible);
    return shown.map((row) => ({
      head: row.parentElement.tagName === "THEAD",
      cells: [...row.cells].filter(visible).flatMap((cell) => [words(cell), ...Array(cell.colSpan - 1).fill("")]),
    }));
  }

  // The lines of a cell are its value, its interval, its mark; those of a head read on.
  function words(cell) {
    const lines = (cell.dataset.export ?? cell.innerText).split("\n").map((line) => line.replace(/[ \t\r\n]+/g, " ").trim()).filter(Boolean);
    return lines.join(cell.closest("thead, th") ? " " : "; ");
  }

  const quoted = (text) => (/[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);

  const csv = (table) => rowsOf(table).map((row) => `${row.cells.map(quoted).join(",")}\n`).join("");

  const GREEK = "αalpha βbeta γgamma δdelta εvarepsilon ζzeta ηeta θtheta κkappa λlambda μmu νnu πpi ρrho σsigma τtau φvarphi χchi ψpsi "
    + "ωomega ΔDelta ΣSigma ΩOmega";
  const SPECIAL = {
    "\\": "\\textbackslash{}", "~": "\\textasciitilde{}", "^": "\\textasciicircum{}", "\u00a0": "~", "\u202f": "\\,", "−": "$-$",
    "×": "$\\times$", "·": "$\\cdot$", "±": "$\\pm$", "√": "$\\surd$", "∞": "$\\infty$", "≤": "$\\leq$", "≥": "$\\geq$",
    "≈": "$\\approx$", "≠": "$\\neq$", "→": "$\\to$", "↦": "$\\mapsto$", "µ": "$\\mu$", "°": "$^\\circ$", "✕": "$\\times$",
    "⁻": "$^-$", "…": "\\dots{}", "–": "--", "—": "---", "‘": "`", "’": "'", "“": "``", "”": "''", "[": "{[}", "]": "{]}",
  };
  for (const sign of "&%$#_{}") SPECIAL[sign] = `\\${sign}`;
  for (const [i, sign] of [..."⁰¹²³⁴⁵⁶⁷⁸⁹"].entries()) SPECIAL[sign] = `$^${i}$`;
  for (const [i, sign] of [..."₀₁₂₃₄₅₆₇₈₉"].entries()) SPECIAL[sign] = `$_${i}$`;
  for (const name of GREEK.split(" ")) SPECIAL[name[0]] = `$\\${name.slice(1)}$`;

  const latex = (text) => [...text].map((sign) => SPECIAL[sign] ?? sign).join("");

  function booktabs(table) {
    const rows = rowsOf(table);
    const columns = Math.max(...rows.map((row) => row.cells.length));
    const line = (row) => `${row.cells.map(latex).join(" & ")} \\\\`;
    return [
      "% Needs \\usepackage{booktabs}.", "\\begin{table}", "\\centering", `\\caption{${latex(titleOf(table))}}`,
      `\\begin{tabular}{${"l".repeat(columns)}}`, "\\toprule", ...rows.filter((row) => row.head).map(line), "\\midrule",
      ...rows.filter((row) => !row.head).map(line), "\\bottomrule", "\\end{tabular}", "\\end{table}", "",
    ].join("\n");
  }

  const titleOf = (table) => table.caption?.textContent.trim() || table.closest("[aria-label]")?.getAttribute("aria-label") || "";

  // Buttons

  const page = location.pathname.split("/").at(-1).replace(/\.html$/, "");
  for (const figure of document.querySelectorAll("figure")) {
    const place = figure.querySelector(".take[data-file]");
    if (!place) continue;
    const [title, name] = [headOf(figure), place.dataset.file];
    place.append(" ", button("SVG", title, () => saveSvg(figure, name)), " ", button("PNG", title, () => savePng(figure, name)));
  }
  [...document.querySelectorAll("main table")].filter((table) => !table.closest("figure")).forEach((table, i) => {
    const place = document.createElement("p");
    const [title, name] = [titleOf(table), `${page}-${table.id || `table-${i + 1}`}`];
    place.className = "take";
    place.append(
      "This table as shown: ",
      button("CSV", title, () => save(`${name}.csv`, asAddress("text/csv", csv(table)))), " ",
      button("LaTeX", title, () => save(`${name}.tex`, asAddress("text/x-tex", booktabs(table)))),
    );
    (table.closest(".scroll") ?? table).after(place);
  });
  return { latex };
})();
