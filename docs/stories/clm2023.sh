# The commands of clm2023.md; run it in the folder of a checkout.
set -eu
fitmodels docs/examples/milling.csv
cat > wear.csv <<'END'
# simulated: no measurement; wear rate of the constant-feed run of Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587
# tool: AA238M-0200-D4-ML-10
# work: S45C
edge,feed rate [mm/min],ap [mm],ae [mm],t [min],VB [um]
1,700,0.2,1.4,0.5,41
1,700,0.2,1.4,1,77
1,700,0.2,1.4,1.5,121
1,700,0.2,1.4,2,157
1,700,0.2,1.4,2.5,205
1,700,0.2,1.4,3,239
2,700,0.2,1.4,0.5,35
2,700,0.2,1.4,1,71
2,700,0.2,1.4,1.5,108
2,700,0.2,1.4,2,140
2,700,0.2,1.4,2.5,180
2,700,0.2,1.4,3,225
3,700,0.2,1.4,0.5,38
3,700,0.2,1.4,1,78
3,700,0.2,1.4,1.5,124
3,700,0.2,1.4,2,156
3,700,0.2,1.4,2.5,203
3,700,0.2,1.4,3,238
4,700,0.2,1.4,0.5,36
4,700,0.2,1.4,1,77
4,700,0.2,1.4,1.5,107
4,700,0.2,1.4,2,155
4,700,0.2,1.4,2.5,184
4,700,0.2,1.4,3,218
5,700,0.2,1.4,0.5,40
5,700,0.2,1.4,1,83
5,700,0.2,1.4,1.5,118
5,700,0.2,1.4,2,159
5,700,0.2,1.4,2.5,205
5,700,0.2,1.4,3,234
6,700,0.2,1.4,0.5,35
6,700,0.2,1.4,1,76
6,700,0.2,1.4,1.5,104
6,700,0.2,1.4,2,149
6,700,0.2,1.4,2.5,183
6,700,0.2,1.4,3,222
END
fitmodels wear.csv --criterion 200um --value V=62.8m/min
fitmodels merge milling-fit/AA238M-0200-D4-ML-10_S45C/params.json wear-fit/AA238M-0200-D4-ML-10_S45C/params.json --take design=wear-fit/AA238M-0200-D4-ML-10_S45C/params.json --out clm.json
fitmodels settings clm.json --worn 0.28 --window 180:220um --wear-limit 200um --idle 0.1
fitmodels ident docs/examples/drive.csv --params clm.json
fitmodels tune clm.json --rise 2 --settle 4 --low 567 --high 1034 --unit mm/min
fitmodels replay clm.json --system constant-load
fitmodels check clm.json
fitmodels export clm.json --to hal --out clm.hal
fitmodels export clm.json --to c --out clm.c
