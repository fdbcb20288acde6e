"""The HTML of reports. Values are put in by jinja2 with escaping on; nothing is loaded from elsewhere."""

HEAD = """<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta http-equiv="Content-Security-Policy"
 content="default-src 'none'; img-src data:; media-src data:; style-src 'unsafe-inline'">
<meta name="viewport" content="width=device-width, initial-scale=1"><title>{{ title }}</title>
<style>
 body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 70rem; padding: 0 1rem; color: #222 }
 h1 { font-size: 1.3rem } h2 { font-size: 1.05rem; margin-top: 2rem }
 img, video { max-width: 100% } figure { display: inline-block; margin: 0 1rem 1rem 0 } figcaption { color: #666 }
 table { border-collapse: collapse; font-size: 13px }
 td, th { padding: .15rem .6rem; text-align: left; border-bottom: 1px solid #ddd }
 .numbers { columns: 3; } .numbers div { break-inside: avoid } .numbers b { font-weight: 600 }
 .wide { overflow-x: auto } pre { background: #f5f5f5; padding: .8rem; overflow-x: auto; font-size: 12px }
</style></head><body>
<h1>{{ title }}</h1>
"""

PATROL = """{% if story %}
<h2>What happened</h2>{% for line in story.lines %}<p>{{ line }}</p>{% endfor %}
<h2>What changed</h2>
<p>Red: new. Blue: gone. Yellow: looks different. Left: now; right: the survey's pictures of the same.</p>
{% for place in story.places %}<section><h3>{{ place.title }}</h3><p>{{ place.found }}</p>
{% if place.pictures %}<img src="{{ place.pictures }}" alt="{{ place.title }}: now, and before">{% endif %}
<p>{{ place.sure }}</p></section>{% endfor %}
<h2>The way driven</h2>{% endif %}"""

RUN = HEAD + PATROL + """
<img src="{{ overview }}" alt="map, trajectories and places of the run">
{% if video %}<h2>Video</h2><video controls src="{{ video }}"></video>{% endif %}
<h2>Numbers</h2><div class="numbers">
{% for name, value in row %}<div><b>{{ name }}</b> {{ value }}</div>{% endfor %}</div>
{% if charts %}<h2>Error and time</h2>{% for name, chart in charts %}
<figure><img src="{{ chart }}" alt="{{ name }}"><figcaption>{{ name }}</figcaption></figure>{% endfor %}{% endif %}
{% if missions %}<h2>Missions</h2><div class="wide"><table>
<tr><th>mission</th><th>place</th><th>status</th><th>reason</th><th>replans</th><th>steps</th></tr>
{% for m in missions %}<tr><td>{{ m.mission }}</td><td>{{ m.place }}</td><td>{{ m.status }}</td><td>{{ m.reason }}</td>
<td>{{ m.replans }}</td><td>{{ m.steps }}</td></tr>{% endfor %}</table></div>{% endif %}
{% if places %}<h2>Pictures taken</h2>{% for name, picture in places %}
<figure><img src="{{ picture }}" alt="{{ name }}"><figcaption>{{ name }}</figcaption></figure>{% endfor %}{% endif %}
{% if config %}<h2>Settings</h2><pre>{{ config }}</pre>{% endif %}
</body></html>
"""

TABLE = """{% macro table(view) %}<div class="wide"><table>
<tr>{% for name in view.names %}<th>{{ name }}</th>{% endfor %}</tr>
{% for row in view.rows %}<tr>{% for cell in row %}<td>{{ cell }}</td>{% endfor %}</tr>{% endfor %}
</table></div>{% endmacro %}
"""

SWEEP = HEAD + TABLE + """
{% for message in unreadable %}<p>Not counted: {{ message }}</p>{% endfor %}
<h2>Per group</h2>{{ table(summary) }}
{% for note in notes %}<p>{{ note }}</p>{% endfor %}
<h2>Charts</h2>{% for chart in charts %}<img src="{{ chart }}" alt="chart">{% endfor %}
{% if worst %}<h2>Runs that did not do what was asked</h2>{% for run, why, picture in worst %}
<figure><img src="{{ picture }}" alt="{{ run }}"><figcaption>{{ run }}: {{ why }}</figcaption></figure>{% endfor %}
{% endif %}
<h2>Runs</h2>{{ table(runs) }}
</body></html>
"""
