from fmfts.cli.main import main

raise SystemExit(main())
