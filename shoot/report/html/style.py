"""How the page looks: dark on white, one column, tables that scroll in their own box."""

from shoot.rendering import palette

RULE = "#d9dee3"
_MODEL_ROW = "#fdf1e8"  # a breath of the colour of what is planned

STYLE = f"""
*{{box-sizing:border-box}}
body{{margin:0 auto;max-width:72rem;padding:1.5rem 1.25rem 4rem;background:{palette.PAPER};
 color:{palette.INK};font:16px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,sans-serif;
 overflow-wrap:break-word}}
h1{{font-size:1.1rem;line-height:1.25;margin:0 0 .5rem;color:{palette.SOFT_INK}}}
h2{{font-size:1.25rem;margin:2.75rem 0 .5rem;padding-top:.75rem;border-top:1px solid {RULE}}}
.answer{{font-size:1.3rem;line-height:1.4;margin:0 0 1rem;padding:0;border:0}}
h3{{font-size:1.02rem;margin:1.75rem 0 .25rem}}
p,ul{{margin:.5rem 0;max-width:46rem}}
li{{margin:.25rem 0}}
a{{color:{palette.DRIVEN}}}
code{{font:.92em ui-monospace,Consolas,monospace;overflow-wrap:anywhere}}
.facts{{display:grid;grid-template-columns:max-content 1fr;gap:.1rem 1rem;margin:1.5rem 0 0}}
.facts dt{{color:{palette.SOFT_INK}}}
.facts dd{{margin:0;overflow-wrap:anywhere}}
nav ul{{display:flex;flex-wrap:wrap;gap:.25rem 1.25rem;list-style:none;padding:0;margin:1.25rem 0}}
.note{{color:{palette.SOFT_INK};font-size:.94rem}}
.scroll{{overflow-x:auto;max-width:100%;margin:.5rem 0 1rem}}
table{{border-collapse:collapse;font-size:.92rem;font-variant-numeric:tabular-nums;min-width:28rem}}
caption{{text-align:left;color:{palette.SOFT_INK};padding-bottom:.25rem}}
th,td{{padding:.3rem .65rem;text-align:right;vertical-align:top;white-space:nowrap}}
thead th{{font-weight:600;border-bottom:1px solid {palette.SOFT_INK};vertical-align:bottom}}
thead tr:not(:last-child) th[colspan]{{text-align:center;border-bottom:1px solid {RULE}}}
thead .first,tbody th,td.first{{border-left:1px solid {RULE}}}
tbody tr{{border-bottom:1px solid {RULE}}}
tbody th,thead th.name{{font-weight:600;text-align:left;position:sticky;left:0;
 background:{palette.PAPER};border-left:0;white-space:normal;min-width:7rem;max-width:13rem}}
tr.model th,tr.model td{{background:{_MODEL_ROW}}}
tr.bound th,tr.bound td{{color:{palette.SOFT_INK};font-style:italic}}
.range,.verdict{{display:block;font-size:.82em;color:{palette.SOFT_INK}}}
strong{{font-weight:700}}
.verdict{{color:{palette.INK};font-weight:600}}
.figures{{display:flex;flex-wrap:wrap;gap:1rem 2rem;margin:.75rem 0}}
figure{{margin:0;max-width:100%}}
figcaption{{font-size:.92rem;margin-top:.25rem}}
svg,img{{display:block;max-width:100%;height:auto}}
svg *{{stroke-linejoin:round;stroke-linecap:butt}}
svg text{{font-family:inherit!important}}
.key{{display:flex;flex-wrap:wrap;gap:.15rem 1.25rem;list-style:none;padding:0;font-size:.92rem}}
.key li{{display:flex;align-items:center;gap:.4rem;margin:0}}
.card{{margin:1rem 0 2rem}}
.card img{{border:1px solid {RULE};width:100%}}
.strip{{overflow-x:auto;margin:.5rem 0}}
.strip img{{width:100%;min-width:56rem}}
.pair{{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,22rem),1fr));
 gap:.5rem 1.25rem}}
.pair .card{{margin:0;min-width:0}}
.pair .card:target{{grid-column:1/-1}}
.summary tbody th{{max-width:min(16rem,40vw)}}
.summary .range,.summary .verdict{{display:inline;margin-left:.4em}}
summary{{cursor:pointer;color:{palette.DRIVEN}}}
@media print{{.scroll{{overflow:visible}}figure,tr{{break-inside:avoid}}}}
"""
