from fmfts.cli import main

raise SystemExit(main())
