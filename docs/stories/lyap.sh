# The commands of lyap.md; run it in the folder of a checkout.
set -eu
fitmodels excite --amplitude 100 --offset 250 --band 0.1:5 --duration 10 --rate 250 --unit mm/min --out feed.csv
fitmodels ident docs/examples/force-chirp.csv --as force-process --depth 2 --spindle 3000rpm --teeth 2 --tool "10 mm end mill" --work SKD41 --out lyap-fit
fitmodels adaptive-force lyap-fit/params.json 1mm=150N 2mm=200N 4mm=320N --feed 60:500mm/min
fitmodels replay lyap-fit/params.json --system adaptive-force
fitmodels check lyap-fit/params.json
fitmodels export lyap-fit/params.json --system adaptive-force --to c --depth 4mm --out lyap.c
