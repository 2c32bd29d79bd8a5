from fmfts.cli.entry import main

raise SystemExit(main())
